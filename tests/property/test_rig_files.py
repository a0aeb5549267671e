"""Rig files with anything in any place: a usable rig or one clear line, never a warning or another error."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from facetcam.errors import FacetcamError
from facetcam.rig import Rig

RIG: dict[str, Any] = {
    "camera": {
        "model": "brown-conrady",
        **{"width": 64, "height": 48, "fx": 50.0, "fy": 50.0, "cx": 31.5, "cy": 23.5},
        "distortion": [0.01, 0.0, 0.0, 0.0, 0.0],
        "T_rig_cam": [[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 0.5], [0, 0, 0, 1]],
    },
    "mirrors": {
        "floor": {"polygon": [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]},
        "wall": {
            "plane": {"normal": [0, 2, 0], "offset": 4},
            "glass": {"thickness": 0.004, "index": 1.5, "thickness_sigma": 1e-4, "index_sigma": 0.01},
        },
    },
    "views": {"up": {"mirrors": ["floor"], "region": [[0, 0], [60, 0], [60, 40]]}},
}


def places(node: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Paths to all values of nested mappings and lists."""
    items = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    for key, value in items:
        yield (*path, key)
        yield from places(value, (*path, key))


PLACES = list(places(RIG))
ANYTHING = st.one_of(
    st.floats(), st.integers(-3, 3), st.just(10**400), st.text(max_size=3), st.none(), st.booleans()
)


@settings(
    max_examples=200,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(place=st.sampled_from(PLACES), value=st.one_of(ANYTHING, st.lists(ANYTHING, max_size=3)))
def test_anything_anywhere_is_a_rig_or_one_line(tmp_path: Path, place: tuple[Any, ...], value: Any) -> None:
    document = copy.deepcopy(RIG)
    node = document
    for key in place[:-1]:
        node = node[key]
    node[place[-1]] = value
    path = tmp_path / "rig.yaml"
    path.write_text(yaml.safe_dump(document))
    try:
        rig = Rig.load(path)
    except FacetcamError as error:
        assert str(error).startswith(f"{path}: ")
        assert "\n" not in str(error)
        return
    assert (rig.labels() == 0).any()
    pixels, _ = rig.project("up" if "up" in rig.views else rig.view_names[0], [[0.1, 0.2, 0.3]])
    assert np.isfinite(pixels).all()
