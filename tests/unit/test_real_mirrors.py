"""Glass in the joint solve, and a board seen only in a hand-held mirror, against what made them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facetcam.calibration.boards import Board, BoardSet
from facetcam.calibration.completion import find_glass, glazed, with_all_chains
from facetcam.calibration.covariance import knowledge
from facetcam.calibration.flatness import flatness
from facetcam.calibration.free_optics import FreeOptics
from facetcam.calibration.hand_mirror import solve_hand_mirror
from facetcam.calibration.optics import MirrorOptics, Optics
from facetcam.calibration.sightings import Sighting
from facetcam.calibration.solve import solve
from facetcam.calibration.uncertainty import uncertainty_maps
from facetcam.errors import FacetcamError
from facetcam.geometry import se3
from facetcam.rig import Camera, Glass, Mirror, Rig, View
from facetcam.rig.files import document, from_document
from facetcam.rig.freedom import moved

BOARD = Board("plain", "chessboard", (8, 7), 0.03)
CAMERA = Camera("brown-conrady", 1600, 1200, 1300.0, 1300.0, 790.0, 610.0, (-0.08, 0.05, 0.0, 0.0, 0.0))
AXES = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])


def table(glass: Glass | None) -> Rig:
    """A camera before two upright mirrors at 90 degrees."""
    slope = np.sqrt(0.5)
    seam = np.array([0.02, 0.9, 0.0])
    normals = {"left": (-slope, slope, 0.0), "right": (slope, slope, 0.0)}
    mirrors = {
        n: replace(Mirror.from_plane(n, v, float(np.array(v) @ seam)), glass=glass)
        for n, v in normals.items()
    }
    T = se3.exp(np.r_[-0.5, 0.02, 0.03, 0.0, 0.0, 0.0]) @ AXES
    return with_all_chains(Rig(CAMERA, T, mirrors, {"direct": View(())}))


def sightings_of(rig: Rig, photos: int, noise: float) -> list[Sighting]:
    rng = np.random.default_rng(1)
    out = []
    for photo in range(photos):
        R = se3.exp(np.r_[rng.uniform(-0.5, 0.5, 3), 0, 0, 0])[:3, :3] @ np.diag([1.0, -1.0, -1.0])
        at = np.array([0.0, 0.6, -0.36]) + rng.uniform(-0.06, 0.06, 3)
        points = BOARD.points @ R.T + at - R @ BOARD.points.mean(axis=0)
        for name in rig.views:
            pixels, seen = rig.project(name, points)
            if seen.sum() > 12:
                found = pixels[seen] + rng.normal(0, noise, (int(seen.sum()), 2))
                out.append(Sighting(photo, 0, np.flatnonzero(seen), found, rig.is_flipped(name), name))
    return out


@pytest.mark.parametrize("free", [False, True])
def test_derivatives_through_glass_agree_with_differences(free: bool) -> None:
    rig = table(Glass(0.006, 1.5))
    mirrors = MirrorOptics.of(rig, list(rig.views), 0.05, 0.01)
    optics: Optics = FreeOptics.of_mirrors(mirrors) if free else mirrors
    points = np.random.default_rng(0).uniform((-0.2, 0.3, -0.4), (0.2, 0.6, -0.1), (20, 3))
    for view in range(len(rig.views)):
        by_points, by_values = optics.derivatives(view, points)
        for axis in range(3):
            step = 1e-6 * np.eye(3)[axis]
            slope = (optics.into_camera(view, points + step) - optics.into_camera(view, points - step)) / 2e-6
            np.testing.assert_allclose(by_points[:, :, axis], slope, atol=1e-6)
        assert len(by_values[0, 0]) == len(optics.columns(view))
        for parameter in np.unique(optics.columns(view)):  # of both mirrors of a sheet together
            nudge = np.zeros(optics.count)
            nudge[parameter] = 1e-6
            ends = [optics.moved(n).into_camera(view, points) for n in (nudge, -nudge)]
            ours = by_values[:, :, optics.columns(view) == parameter].sum(axis=2)
            np.testing.assert_allclose(ours, (ends[0] - ends[1]) / 2e-6, atol=2e-3)


def test_free_views_begin_where_the_mirrors_have_them() -> None:
    rig = table(Glass(0.006, 1.5))
    mirrors = MirrorOptics.of(rig, list(rig.views), 0.05, 0.01)
    free = FreeOptics.of_mirrors(mirrors)
    points = np.random.default_rng(0).uniform((-0.2, 0.3, -0.4), (0.2, 0.6, -0.1), (20, 3))
    for view in range(len(rig.views)):
        np.testing.assert_allclose(
            free.into_camera(view, points), mirrors.into_camera(view, points), atol=1e-12
        )


def test_the_solvers_projection_is_that_of_the_rig() -> None:
    rig = table(Glass(0.006, 1.5))
    optics = MirrorOptics.of(rig, list(rig.views), 0.05, 0.01)
    points = np.random.default_rng(0).uniform((-0.2, 0.3, -0.4), (0.2, 0.6, -0.1), (50, 3))
    for view, name in enumerate(rig.views):
        pixels, seen = rig.project(name, points)
        mine, valid = CAMERA.project(optics.into_camera(view, points))
        assert seen.any()
        assert valid[seen].all()
        np.testing.assert_allclose(mine[seen], pixels[seen], atol=1e-8)


def test_the_thickness_of_glass_is_found() -> None:
    true = table(Glass(0.006, 1.52))
    sightings = sightings_of(true, 8, 0.1)
    calibration = solve(glazed(true, 0.0), BoardSet((BOARD,)), sightings)
    found = find_glass(calibration.fit)
    assert abs(found.thickness - 0.006) < 4 * found.sigma + 2e-4
    assert 0 < found.sigma < 0.001
    none = solve(glazed(true, 0.0), BoardSet((BOARD,)), sightings_of(table(None), 8, 0.1))
    bare = find_glass(none.fit)
    assert bare.thickness < 3 * bare.sigma


def test_glass_is_solved_for_and_stands_in_the_covariance() -> None:
    true = table(Glass(0.006, 1.52))
    sightings = sightings_of(true, 8, 0.1)
    found = solve(glazed(true, 0.004), BoardSet((BOARD,)), sightings)
    at = found.parameters.names.index("left, right: thickness")
    value, sigma = found.parameters.value[at], found.parameters.sigma[at]
    assert found.parameters.units[at] == "mm"
    assert abs(value - 6.0) < 3 * sigma and sigma < 0.5
    back = from_document(document(found.rig))
    pane = back.mirrors["left"].glass
    assert pane is not None and pane.thickness == pytest.approx(1e-3 * value)
    assert pane.thickness_sigma == pytest.approx(1e-3 * sigma)
    assert back.covariance is not None and "right: thickness" in back.covariance.parameters
    step = np.zeros(len(back.covariance.parameters))
    step[back.covariance.parameters.index("right: thickness")] = 1e-3
    after = moved(back, back.covariance, step)
    assert after.mirrors["right"].glass == replace(pane, thickness=pane.thickness + 1e-3)
    assert after.mirrors["left"].glass == pane


def test_flat_mirrors_behind_glass_look_flat() -> None:
    glass = Glass(0.006, 1.52, thickness_sigma=0.004, index_sigma=0.01)
    rig = table(glass)
    found = solve(rig, BoardSet((BOARD,)), sightings_of(rig, 8, 0.1))
    flat = flatness(found.fit, found.noise)
    assert flat is not None and flat.flat and 0.2 < flat.ratio < 3.0


def test_what_is_stated_of_glass_is_carried_into_the_views() -> None:
    """A sheet that photos hardly tell of: its sigma stays, and is in the views."""
    sightings = sightings_of(table(Glass(0.006)), 3, 0.3)
    sigma = {}
    for stated in (0.0, 1e-4, 1e-3):
        drawn = glazed(table(None), 0.0)
        glass = Glass(0.006, 1.52, thickness_sigma=stated, index_sigma=0.0)
        drawn = replace(drawn, mirrors={n: replace(m, glass=glass) for n, m in drawn.mirrors.items()})
        found = solve(drawn, BoardSet((BOARD,)), sightings)
        known = dict(zip(found.parameters.names, found.parameters.sigma))
        assert ("left, right: thickness" in known) == (stated > 0)
        assert "left, right: index" not in known
        assert not any("thickness" in u.what or "index" in u.what for u in found.unobservable)
        maps = uncertainty_maps(found.fit, knowledge(found.fit, 0.3), 0.5)
        middle = float(np.nanmedian(np.concatenate([m.sigma_px.ravel() for m in maps])))
        sigma[stated] = known.get("left, right: thickness", 0.0), middle
    assert sigma[1e-4][0] == pytest.approx(0.1, rel=0.03)  # mm, as stated
    assert sigma[1e-3][0] < 1.0  # the photos know better
    assert sigma[0.0][1] < sigma[1e-4][1] < sigma[1e-3][1]


def hand_held(normals: list[list[float]], noise: float) -> tuple[list[Sighting], np.ndarray]:
    """A board beside the camera, seen in a mirror before it; and its place."""
    rng = np.random.default_rng(2)
    T = se3.exp(np.r_[0.1, 2.9, 0.2, 0.0, 0.0, 0.0])
    T[:3, 3] = [0.25, -0.1, 0.05]
    out = []
    for i, normal in enumerate(normals):
        n = np.array(normal) / np.linalg.norm(normal)
        mirror = Mirror.from_plane("m", AXES[:3, :3] @ n, 0.45 + 0.01 * i)
        rig = Rig(CAMERA, AXES, {"m": mirror}, {"m": View(("m",))})
        points = se3.transform(AXES @ T, BOARD.points)
        pixels, seen = rig.project("m", points)
        assert seen.all()
        out.append(Sighting(i, 0, np.arange(42), pixels + rng.normal(0, noise, (42, 2)), True))
    return out, T


def test_a_board_seen_only_in_a_hand_held_mirror() -> None:
    normals = [[0.2, -0.1, 1.0], [0.3, -0.05, 1.0], [0.22, -0.22, 1.0], [0.1, -0.15, 1.0], [0.25, 0.0, 1.0]]
    sightings, T = hand_held(normals, 0.05)
    plain = replace(CAMERA, distortion=(0.0,) * 5)
    found = solve_hand_mirror(BOARD, sightings, plain)
    turn = T[:3, :3].T @ found.T_cam_board[:3, :3]
    assert np.degrees(np.arccos((np.trace(turn) - 1) / 2)) < 0.3
    assert np.linalg.norm(found.T_cam_board[:3, 3] - T[:3, 3]) < 0.01 * np.linalg.norm(T[:3, 3]) + 1e-3
    assert abs(found.rig.camera.distortion[0] + 0.08) < 0.02
    assert found.rig.camera.fx == 1300.0
    assert found.rms < 0.15


def test_what_a_hand_held_mirror_cannot_tell_is_refused() -> None:
    normals = [[0.2, -0.1, 1.0], [0.3, -0.1, 1.0], [0.1, -0.1, 1.0]]
    sightings, _ = hand_held(normals, 0.0)
    with pytest.raises(FacetcamError, match="three or more"):
        solve_hand_mirror(BOARD, sightings[:2], CAMERA)
    with pytest.raises(FacetcamError, match="tilt the mirror about two axes"):
        solve_hand_mirror(BOARD, sightings, CAMERA)
    with pytest.raises(FacetcamError, match="shows the board directly"):
        solve_hand_mirror(BOARD, [replace(s, mirrored=False) for s in sightings], CAMERA)
