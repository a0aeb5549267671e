"""The covariance and the origin that a rig file carries."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from facetcam.errors import RigError
from facetcam.rig import Rig, RigCovariance, presets
from facetcam.rig.covariance import Axes

NAMES = ("fx", "k1", "left: tilt u", "left: shift")
AXES = {"left": Axes((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.1, 0.2))}


def known_rig() -> Rig:
    root = np.random.default_rng(0).standard_normal((4, 4)) * np.array([[0.1], [1e-3], [1e-5], [1e-5]])
    return replace(
        presets.ryu(), covariance=RigCovariance(NAMES, root @ root.T, AXES), solved_from="0123456789abcdef"
    )


def test_covariance_survives_the_file_bit_by_bit(tmp_path: Path) -> None:
    rig = known_rig()
    rig.save(tmp_path / "rig.yaml")
    back = Rig.load(tmp_path / "rig.yaml")
    assert back.covariance is not None and rig.covariance is not None
    assert back.covariance.parameters == NAMES and back.covariance.axes == AXES
    np.testing.assert_array_equal(back.covariance.matrix, rig.covariance.matrix)
    assert back.solved_from == rig.solved_from and back.digest == rig.digest
    assert replace(rig, covariance=None).digest != rig.digest


def test_a_rig_without_keeps_its_file_and_digest(tmp_path: Path) -> None:
    presets.ryu().save(tmp_path / "rig.yaml")
    assert set(yaml.safe_load((tmp_path / "rig.yaml").read_text())) == {"camera", "mirrors", "views"}
    back = Rig.load(tmp_path / "rig.yaml")
    assert back.covariance is None and back.solved_from is None


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"covariance": {"parameters": ["fx"], "matrix": [[1.0, 2.0]]}}, "1x1"),
        ({"covariance": {"parameters": ["fx"], "matrix": [[-1.0]]}}, "above zero"),
        ({"covariance": {"parameters": ["fx", "fy"], "matrix": [[1.0, 0.5], [0.4, 1.0]]}}, "symmetric"),
        ({"covariance": {"parameters": ["fx", "fy"], "matrix": [[1.0, 2.0], [2.0, 1.0]]}}, "negative"),
        ({"covariance": {"parameters": ["fx", "fx"], "matrix": [[1.0, 0.0], [0.0, 1.0]]}}, "twice"),
        ({"covariance": {"parameters": ["fz"], "matrix": [[1.0]]}}, "'fz'"),
        ({"covariance": {"parameters": ["left: tilt u"], "matrix": [[1.0]]}}, "needs the axes"),
        ({"covariance": {"parameters": ["lamp: thickness"], "matrix": [[1.0]]}}, "'lamp: thickness'"),
        ({"covariance": {"parameters": ["fx", "fy"], "matrix": [[1.0], [0.4, 1.0]]}}, "lengths"),
        ({"covariance": {"parameter": ["fx"], "matrix": [[1.0]]}}, "did you mean 'parameters'"),
        ({"covariance": [1.0]}, "expected keys"),
        ({"covariance": {"parameters": ["fx"], "matrix": [[1.0]], "axes": 3}}, "axes"),
        ({"solved_from": "not a digest"}, "hexadecimal"),
        ({"solved_form": "0123456789abcdef"}, "did you mean 'solved_from'"),
    ],
)
def test_refuses_what_is_no_covariance(tmp_path: Path, change: dict[str, object], message: str) -> None:
    presets.ryu().save(tmp_path / "good.yaml")
    content = yaml.safe_load((tmp_path / "good.yaml").read_text()) | change
    (tmp_path / "bad.yaml").write_text(yaml.safe_dump(content))
    with pytest.raises(RigError, match=message):
        Rig.load(tmp_path / "bad.yaml")
