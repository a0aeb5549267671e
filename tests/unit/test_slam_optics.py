"""The ideal pinholes of the views, against the rig's own projection and rays."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from slam_worlds import fisheye, folded, look, pyramid, walls

from facetcam.geometry import se3
from facetcam.rig import NO_VIEW, Rig
from facetcam.slam.camera.optics import Optics

Array = NDArray[np.float64]

MARGIN = 8.0


@pytest.fixture(scope="module", params=[folded, pyramid, fisheye], ids=lambda make: make.__name__)
def optics(request: pytest.FixtureRequest) -> Optics:
    make: Callable[[], Rig] = request.param
    return Optics(make(), MARGIN)


@pytest.fixture(scope="module")
def points() -> Array:
    return walls(np.random.default_rng(1), 3000)


def test_projection_is_the_rigs_inside_the_mask(optics: Optics, points: Array) -> None:
    for index, (name, pixels, valid) in enumerate(zip(optics.rig.view_names, *optics.project(points))):
        expected, visible = optics.rig.project(name, points)
        assert valid.sum() > 20
        np.testing.assert_allclose(pixels[valid], expected[valid], atol=1e-9)
        assert np.all(visible[valid])
        assert np.array_equal(valid, visible & (optics.view_of(expected) == index))


def test_rays_are_the_rigs(optics: Optics, points: Array) -> None:
    seen = look(optics, np.eye(4), points)
    rays, origins = optics.rays(seen.pixels, seen.view), optics.origins(seen.view)
    for index, name in enumerate(optics.rig.view_names):
        rows = seen.view == index
        expected_origins, expected_rays = optics.rig.ray(name, seen.pixels[rows])
        np.testing.assert_allclose(rays[rows], expected_rays, atol=1e-12)
        np.testing.assert_allclose(origins[rows], expected_origins, atol=1e-12)


def test_pixels_and_points_meet_on_the_pinhole(optics: Optics, points: Array) -> None:
    seen = look(optics, np.eye(4), points)
    plane, depth = optics.to_plane(points[seen.point], seen.view)
    assert np.all(depth > 0)
    np.testing.assert_allclose(seen.plane, plane, atol=1e-3)
    towards = points[seen.point] - optics.origins(seen.view)
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    np.testing.assert_allclose(optics.plane_rays(plane, seen.view), towards, atol=1e-12)


def test_pinholes_are_proper_even_behind_odd_chains(optics: Optics) -> None:
    for index, T in enumerate(optics.T_view_rig):
        se3.assert_proper_rotation(T[:3, :3])
        np.testing.assert_allclose(T @ optics.T_rig_view[index], np.eye(4), atol=1e-12)
        assert optics.flipped[index] == optics.rig.is_flipped(optics.rig.view_names[index])


def test_pinholes_look_along_the_middle_of_their_view(optics: Optics) -> None:
    for index, name in enumerate(optics.rig.view_names):
        rows, columns = np.nonzero(optics.labels == index)
        _, rays = optics.rig.ray(name, np.column_stack([columns, rows]))
        middle = rays.mean(axis=0) / np.linalg.norm(rays.mean(axis=0))
        assert optics.T_rig_view[index, :3, 2] @ middle > np.cos(np.radians(2.0))


def test_labels_are_the_rigs_away_from_the_seams(optics: Optics) -> None:
    labelled = optics.labels != NO_VIEW
    assert np.array_equal(labelled, optics.mask > 0)
    assert np.array_equal(optics.labels[labelled], optics.rig.labels()[labelled])
    assert np.all(optics.rig.mask(MARGIN)[labelled] > 0)


def test_views_of_pixels_off_the_frame() -> None:
    optics = Optics(folded(), MARGIN)
    width, height = optics.rig.size
    far = np.array([[-1.0, 5.0], [width, 5.0], [5.0, -1.0], [5.0, height], [1e6, -1e6]])
    assert np.all(optics.view_of(far) == NO_VIEW)


def test_rays_steeper_than_a_pinhole_can_hold_are_left_out() -> None:
    optics = Optics(fisheye(), MARGIN)
    rows, columns = np.mgrid[0:600, 0:600].reshape(2, -1)
    _, rays = optics.rig.ray("front", np.column_stack([columns, rows]))
    steep = rays @ optics.T_rig_view[0, :3, 2] < np.cos(np.radians(75.0))
    covered = optics.labels[rows, columns] != NO_VIEW
    assert steep.mean() > 0.1
    assert np.array_equal(covered, ~steep & (optics.rig.mask(MARGIN)[rows, columns] > 0))


def test_jacobians_are_the_slope_of_the_projection(optics: Optics, points: Array) -> None:
    seen = look(optics, np.eye(4), points)
    point = points[seen.point]
    step = 1e-5 * np.random.default_rng(2).standard_normal((len(point), 3, 2))
    jacobian = optics.jacobians(seen.view, point, step)
    for index, name in enumerate(optics.rig.view_names):
        rows = seen.view == index
        for axis in (0, 1):
            moved, _ = optics.rig.project(name, point[rows] + step[rows, :, axis])
            np.testing.assert_allclose(jacobian[rows, :, axis], moved - seen.pixels[rows], atol=1e-6)


def test_roll_is_the_direction_of_level_on_the_raw_frame(optics: Optics) -> None:
    """A step to the right of a view's upright pinhole goes along its roll on the raw frame."""
    for index, name in enumerate(optics.rig.view_names):
        T = optics.T_rig_view[index]
        centre = T[:3, 3] + 2.0 * T[:3, 2]
        (a, b), visible = optics.rig.project(name, [centre, centre + 0.01 * T[:3, 0]])
        assert visible.all()
        angle = np.degrees(np.arctan2(*(b - a)[::-1]))
        assert (angle - optics.roll_degrees[index] + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=1.0)


def test_a_plumb_line_is_upright_wherever_it_is_seen(optics: Optics, points: Array) -> None:
    """A step up goes 90 degrees before the upright angle, or after it in a mirror image."""
    rays = points / np.linalg.norm(points, axis=1, keepdims=True)
    level = points[np.abs(rays[:, 2]) < 0.8]
    for index, name in enumerate(optics.rig.view_names):
        foot, visible = optics.rig.project(name, level)
        top, _ = optics.rig.project(name, level + np.array([0.0, 0.0, 1e-4]))
        rows = visible & (optics.view_of(foot) == index)
        assert rows.sum() > 20
        views = np.full(rows.sum(), index, np.int8)
        expected = np.degrees(np.arctan2(*(top - foot)[rows].T[::-1]))
        expected += -90.0 if optics.flipped[index] else 90.0
        away = (optics.upright_degrees(foot[rows], views) - expected + 180.0) % 360.0 - 180.0
        assert np.abs(away).max() < 0.5
