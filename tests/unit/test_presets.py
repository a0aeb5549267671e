"""The built-in rigs against the drawing of the paper's rig and against plain geometry."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from facetcam.errors import RigError
from facetcam.rig import NO_VIEW, Rig, presets


def test_ryu_is_the_rig_of_the_drawing(shared_data: Path) -> None:
    drawn, built = Rig.load(shared_data / "house" / "rig_nominal.yaml"), Rig.load("preset:ryu")
    assert built.camera == drawn.camera
    np.testing.assert_allclose(built.T_rig_cam, drawn.T_rig_cam, atol=1e-12)
    for name, mirror in drawn.mirrors.items():
        gaps = np.linalg.norm(mirror.polygon[:, None] - built.mirrors[name].polygon[None], axis=2)
        assert gaps.min(axis=1).max() < 1e-9
    assert {name: view.mirrors for name, view in built.views.items()} == {
        name: view.mirrors for name, view in drawn.views.items()
    }


def test_ryu_has_the_size_of_the_paper() -> None:
    rig = presets.ryu()
    corners = np.vstack([mirror.polygon for mirror in rig.mirrors.values()])
    np.testing.assert_allclose(np.ptp(corners, axis=0), [0.180, 0.135, 0.125], atol=1e-12)


@pytest.mark.parametrize("faces", [3, 4, 5, 6])
@pytest.mark.parametrize("make", [presets.ryu, presets.pyramid])
def test_every_face_looks_its_own_way(make: Callable[..., Rig], faces: int) -> None:
    rig = make(faces, radius=0.08)
    assert len(rig.views) == faces
    for i, name in enumerate(rig.views):
        label = rig.view_names.index(name)
        v, u = np.nonzero(rig.labels() == label)
        _, directions = rig.ray(name, np.column_stack([u, v])[::50])
        mean = directions.mean(axis=0)
        expected = math.pi / 2 + math.tau * i / faces
        turn = math.atan2(mean[1], mean[0]) - expected
        assert abs(math.remainder(turn, math.tau)) < math.radians(15)


def test_table_sees_one_point_five_times() -> None:
    rig = presets.table()
    point = np.array([[0.02, -0.2, 0.08]])
    labels = rig.labels()
    seen = 0
    for index, name in enumerate(rig.views):
        pixel, visible = rig.project(name, point)
        if visible[0]:
            u, v = np.round(pixel[0]).astype(int)
            assert labels[v, u] == index
            seen += 1
    # Mirrors at 90 degrees show one image in both, on one side of the seam or the other.
    assert seen == 4


def test_no_point_or_pixel_is_no_trouble_and_infinity_is_not_visible() -> None:
    rig = presets.table()
    assert rig.project("left", np.empty((0, 3)))[0].shape == (0, 2)
    assert rig.sees("left", np.empty((0, 2))).shape == (0,)
    far = [[np.nan, 0.0, 0.0], [np.inf, 0.0, 1.0], [0.0, -0.3, 0.1]]
    assert rig.project("left", far)[1].tolist() == [False, False, True]


def test_mask_keeps_the_margin_from_seams_and_border() -> None:
    rig = presets.table()
    labels = rig.labels()
    valid = rig.mask(10.0)
    assert not valid[:10].any() and not valid[:, -10:].any()
    v, u = np.nonzero(valid)
    for du, dv in ((10, 0), (-10, 0), (0, 10), (0, -10), (7, 7), (-7, 7)):
        np.testing.assert_array_equal(labels[v + dv, u + du], labels[v, u])
    assert not rig.mask()[labels == NO_VIEW].any()
    with pytest.raises(RigError, match="zero or more"):
        rig.mask(-1.0)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: presets.ryu(faces=2), "three or more faces"),
        (lambda: presets.ryu(depth=0.07), "cross each other"),
        (lambda: presets.ryu(tilt=math.radians(80)), "do not fit above a base"),
        (lambda: presets.ryu(camera_height=-0.1), "no pixel sees the room"),
        (lambda: presets.pyramid(radius=float("nan")), "a radius above zero"),
        (lambda: presets.pyramid(tilt=math.radians(85)), "must stand between"),
    ],
)
def test_impossible_parameters_are_refused(make: Callable[[], Rig], message: str) -> None:
    with pytest.raises(RigError, match=message):
        make()
