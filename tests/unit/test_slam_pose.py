"""Pose from points in the views, against known poses."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2
from slam_worlds import fisheye, folded, in_sight, look, pyramid, walls, winding_path

from facetcam.geometry import se3
from facetcam.rig import Rig
from facetcam.slam.camera.optics import Optics
from facetcam.slam.camera.pose import generalized_pose, judged_pose, refine_pose
from facetcam.slam.camera.sight import Sights, linearise

Array = NDArray[np.float64]

TRUE = se3.exp([0.04, -0.06, 0.9, 0.3, -0.2, 0.1])
NEAR = TRUE @ se3.exp([0.03, -0.02, 0.04, 0.05, -0.04, 0.03])
LITTLE = se3.exp([0.003, -0.002, 0.004, 0.005, -0.004, 0.003])
MOVED = TRUE @ se3.exp([0.0, 0.0, 0.04, 0.2, 0.2, 0.0])


@pytest.fixture(scope="module", params=[folded, pyramid, fisheye], ids=lambda make: make.__name__)
def optics(request: pytest.FixtureRequest) -> Optics:
    make: Callable[[], Rig] = request.param
    return Optics(make(), 8.0)


def with_outliers(plane: Array, rng: np.random.Generator, share: float) -> tuple[Array, NDArray[np.bool_]]:
    """Positions of which a share is moved elsewhere, by 20 pixels or more."""
    wrong = rng.random(len(plane)) < share
    angle, far = rng.uniform(0, 2 * np.pi, len(plane)), rng.uniform(20, 100, len(plane))
    moved = plane + far[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    return np.where(wrong[:, None], moved, plane), wrong


def errors(T: Array) -> tuple[float, float]:
    """Degrees and metres from the true pose."""
    twist = se3.log(se3.inverse(TRUE) @ T)
    return float(np.degrees(np.linalg.norm(twist[:3]))), float(np.linalg.norm(twist[3:]))


def test_derivatives_are_the_slope_of_the_residuals(optics: Optics) -> None:
    points = walls(np.random.default_rng(4), 2000)
    seen = look(optics, TRUE, points)
    rng = np.random.default_rng(9)
    edge = rng.uniform(-0.7, 0.7, (len(seen.point), 2))
    args = Sights(points[seen.point], seen.view, seen.plane, edge), optics
    residual, J = linearise(NEAR, *args)
    for axis, unit in enumerate(np.eye(6)):
        ahead, behind = (linearise(NEAR @ se3.exp(s * 1e-6 * unit), *args)[0] for s in (1, -1))
        np.testing.assert_allclose(J[:, :, axis], (ahead - behind) / 2e-6, rtol=1e-4, atol=1e-2)
    np.testing.assert_allclose(linearise(TRUE, *args)[0], 0.0, atol=1e-3)
    assert np.abs(residual).max() > 1.0


def test_a_near_pose_is_pulled_in_through_outliers(optics: Optics) -> None:
    rng = np.random.default_rng(5)
    points = walls(rng, 3000)
    seen = look(optics, TRUE, points)
    plane, wrong = with_outliers(seen.plane, rng, 0.3)
    pose = refine_pose(NEAR, Sights.of_corners(points[seen.point], seen.view, plane), optics, 0.5)
    degrees, metres = errors(pose.T_world_rig)
    assert degrees < 0.05
    assert metres < 0.01
    assert np.array_equal(pose.residuals > 3.0, wrong)
    se3.assert_proper_rotation(pose.T_world_rig[:3, :3], tolerance=1e-12)


def test_points_behind_a_view_do_not_fit() -> None:
    optics = Optics(folded(), 8.0)
    points = walls(np.random.default_rng(6), 2000)
    seen = look(optics, TRUE, points)
    centre = se3.transform(TRUE, optics.origins(seen.view))
    place = points[seen.point]
    place[:5] = 2.0 * centre[:5] - place[:5]
    pose = refine_pose(TRUE, Sights.of_corners(place, seen.view, seen.plane), optics, 0.5)
    assert np.all(np.isinf(pose.residuals[:5]))
    assert np.all(pose.residuals[5:] < 0.01)


def test_covariance_tells_the_errors_that_noise_makes(optics: Optics) -> None:
    """Squared errors over the covariance follow the chi-square law of six degrees of freedom."""
    rng = np.random.default_rng(7)
    points = walls(rng, 4000)
    seen = look(optics, TRUE, points)
    trials = 50
    squares = []
    for _ in range(trials):
        plane = seen.plane + rng.normal(0.0, 0.4, seen.plane.shape)
        pose = refine_pose(NEAR, Sights.of_corners(points[seen.point], seen.view, plane), optics, 0.5)
        twist = se3.log(se3.inverse(pose.T_world_rig) @ TRUE)
        squares.append(twist @ np.linalg.solve(pose.covariance, twist))
    low, high = chi2.ppf([1e-4, 1 - 1e-4], 6 * trials)
    # The robust kernel weighs good measurements down, which costs up to twice the variance.
    assert low < np.sum(squares) < 2.0 * high


def test_a_pose_beside_that_of_the_points_is_told_to_be_less_sure(optics: Optics) -> None:
    rng = np.random.default_rng(11)
    points = walls(rng, 1500)
    seen = look(optics, TRUE, points)
    plane = seen.plane + rng.normal(0.0, 0.3, seen.plane.shape)
    args = Sights.of_corners(points[seen.point], seen.view, plane), optics, 0.5
    best = refine_pose(NEAR, *args)
    again, beside = judged_pose(best.T_world_rig, *args), judged_pose(TRUE @ LITTLE, *args)
    np.testing.assert_array_equal(again.covariance, best.covariance)
    np.testing.assert_array_equal(again.residuals, best.residuals)
    np.testing.assert_array_equal(beside.T_world_rig, TRUE @ LITTLE)
    assert np.trace(beside.covariance) > 1.5 * np.trace(best.covariance)


def test_ransac_needs_no_first_pose(optics: Optics) -> None:
    rng = np.random.default_rng(8)
    points = walls(rng, 3000)
    seen = look(optics, TRUE, points)
    plane, wrong = with_outliers(seen.plane, rng, 0.3)
    T, inliers = generalized_pose(points[seen.point], seen.view, plane, optics, 6.0)
    assert T is not None
    degrees, metres = errors(T)
    assert degrees < 0.1
    assert metres < 0.02
    assert np.array_equal(inliers, ~wrong)


def test_ransac_gives_the_same_answer_twice() -> None:
    optics = Optics(folded(), 8.0)
    rng = np.random.default_rng(9)
    points = walls(rng, 3000)
    seen = look(optics, TRUE, points)
    plane, _ = with_outliers(seen.plane, rng, 0.4)
    first, second = (generalized_pose(points[seen.point], seen.view, plane, optics, 6.0)[0] for _ in range(2))
    assert first is not None and second is not None
    assert first.tobytes() == second.tobytes()


def test_ransac_gives_the_same_answer_wherever_its_points_lie_in_memory() -> None:
    """A far wall in a corner of one view hardly holds a pose: PoseLib's eighth digit differs."""
    optics, rng = Optics(folded(), 8.0), np.random.default_rng(12)
    x, y = rng.uniform(-1.0, 1.0, (2, 3000))
    points = TRUE[:3, 3] + 8.0 * TRUE[:3, 1] + x[:, None] * TRUE[:3, 0] + y[:, None] * TRUE[:3, 2]
    seen = look(optics, TRUE, points)
    rows = np.flatnonzero(seen.view == np.bincount(seen.view).argmax())[:40]
    assert len(rows) == 40
    plane = seen.plane[rows] + rng.normal(0.0, 0.7, (40, 2))
    answers, filled = set(), []
    for size in rng.integers(1, 5000, 100):
        filled.append(bytes(int(size)))
        T, _ = generalized_pose(points[seen.point[rows]], seen.view[rows], plane.copy(), optics, 6.0)
        assert T is not None
        answers.add(T.tobytes())
    assert len(answers) == 1


def test_ransac_finds_nothing_in_too_few_points() -> None:
    optics = Optics(folded(), 8.0)
    points = walls(np.random.default_rng(10), 2000)
    seen = look(optics, TRUE, points)
    T, inliers = generalized_pose(points[seen.point[:3]], seen.view[:3], seen.plane[:3], optics, 6.0)
    assert T is None
    assert inliers.tolist() == [False] * 3


def test_the_native_refinement_finds_the_least_robust_cost(optics: Optics) -> None:
    """No small move of the pose lowers the Cauchy cost of noisy sightings with wrong ones among them."""
    rng = np.random.default_rng(31)
    T = winding_path(3)[2]
    points = in_sight(optics, T[None], rng, 400)
    sight = look(optics, T, points)
    plane = sight.plane + rng.normal(0.0, 0.4, sight.plane.shape)
    plane[::7] += 15.0
    xyz, sigma = points[sight.point], 0.5

    def cost(pose: Array) -> float:
        seen, _ = optics.to_plane(se3.transform(se3.inverse(pose), xyz), sight.view)
        return float(np.sum(np.log1p(np.sum((seen - plane) ** 2, axis=1) / sigma**2)))

    start = T @ se3.exp([0.01, -0.02, 0.01, 0.05, 0.03, -0.04])
    found = refine_pose(start, Sights.of_corners(xyz, sight.view, plane), optics, sigma).T_world_rig
    assert cost(found) < cost(start)
    for axis in np.eye(6):
        for step in (1e-4, -1e-4):
            assert cost(found @ se3.exp(step * axis)) > cost(found)


def wall_seen_by(
    optics: Optics, view: int, rng: np.random.Generator
) -> tuple[Array, NDArray[np.int8], Array]:
    """Points of a wall 7 m before one view, as it sees them with little noise, and one that seems near."""
    rows, columns = np.nonzero(optics.labels == view)
    pick = rng.integers(0, len(rows), 90)
    pixels = np.column_stack([columns[pick], rows[pick]]).astype(float)
    views = np.full(90, view, np.int8)
    rays, origins = optics.rays(pixels, views), optics.origins(views)
    axis = optics.T_rig_view[view, :3, 2]
    points = origins + (7.0 / (rays @ axis))[:, None] * rays
    points[0] = origins[0] + 0.2 * (points[0] - origins[0])
    points = se3.transform(TRUE, points)
    plane, _ = optics.to_plane(se3.transform(se3.inverse(MOVED), points), views)
    return points, views, plane + rng.normal(0.0, 0.15, plane.shape)


@pytest.mark.parametrize("view", range(4))
def test_a_wrong_point_before_a_far_wall_does_not_pull_the_pose(view: int) -> None:
    """One of 90 points is mapped near but moves with the wall: it holds what the wall hardly tells."""
    optics, rng = Optics(folded(), 8.0), np.random.default_rng([32, view])
    points, views, plane = wall_seen_by(optics, view, rng)
    on_wall = se3.transform(TRUE, optics.origins(views[:1]))
    on_wall = on_wall + 5.0 * (points[:1] - on_wall)
    wrong = plane.copy()
    wrong[:1], _ = optics.to_plane(se3.transform(se3.inverse(MOVED), on_wall), views[:1])
    every = Sights.of_corners(points, views, wrong)
    right = refine_pose(MOVED @ LITTLE, every.take(np.arange(len(points)) > 0), optics, 0.5).T_world_rig
    pulled = refine_pose(MOVED @ LITTLE, every, optics, 0.5)
    np.testing.assert_allclose(pulled.T_world_rig, right, atol=1e-6)
    assert pulled.residuals[0] > 3.0


@pytest.mark.parametrize("view", range(4))
def test_a_true_point_before_a_far_wall_is_heard(view: int) -> None:
    """It tells the pose better than all of the wall."""
    optics = Optics(folded(), 8.0)
    off = []
    for seed in range(10):
        points, views, plane = wall_seen_by(optics, view, np.random.default_rng([33, view, seed]))
        for first in (0, 1):
            seen = Sights.of_corners(points[first:], views[first:], plane[first:])
            T = refine_pose(MOVED @ LITTLE, seen, optics, 0.5).T_world_rig
            off.append(float(np.linalg.norm(se3.log(se3.inverse(MOVED) @ T)[3:])))
    assert np.median(off[::2]) < 0.8 * np.median(off[1::2])


def test_few_points_of_another_view_are_heard() -> None:
    """Of a map of the wrong scale, they alone tell: left out as too few, the scale could never be mended."""
    optics, rng = Optics(folded(), 8.0), np.random.default_rng(34)
    points = walls(rng, 4000)
    seen = look(optics, TRUE, points)
    most = np.flatnonzero(seen.view == 1)[:150]
    few = np.flatnonzero(seen.view == 0)[:4]
    rows = np.concatenate([most, few])
    stretched = seen.plane.copy()
    stretched[few] += 4.0
    T, alone = (
        refine_pose(TRUE, Sights.of_corners(points[seen.point[r]], seen.view[r], stretched[r]), optics, 0.5)
        for r in (rows, most)
    )
    assert np.linalg.norm(se3.log(se3.inverse(alone.T_world_rig) @ T.T_world_rig)) > 1e-3
    assert np.max(T.residuals[-4:]) < np.max(np.linalg.norm(stretched[few] - seen.plane[few], axis=1))


def with_one_elsewhere(
    optics: Optics, view: int, rng: np.random.Generator, off: float
) -> tuple[Sights, Sights]:
    """A far wall before one view and a point before another, `off` pixels beside it; the wall alone."""
    points, views, plane = wall_seen_by(optics, view, rng)
    walls_too = walls(rng, 2000)
    seen = look(optics, MOVED, walls_too)
    row = np.flatnonzero(seen.view != view)[:1]
    wall = Sights.of_corners(points[1:], views[1:], plane[1:])
    both = Sights.of_corners(
        np.concatenate([points[1:], walls_too[seen.point[row]]]),
        np.concatenate([views[1:], seen.view[row]]),
        np.concatenate([plane[1:], seen.plane[row] + off]),
    )
    return both, wall


@pytest.mark.parametrize("view", range(4))
def test_in_a_settled_map_a_lone_point_of_another_view_must_agree_with_the_rest(view: int) -> None:
    optics = Optics(folded(), 8.0)
    both, wall = with_one_elsewhere(optics, view, np.random.default_rng([35, view]), 12.0)
    right = refine_pose(MOVED @ LITTLE, wall, optics, 0.5).T_world_rig
    growing, settled = (
        refine_pose(MOVED @ LITTLE, both, optics, 0.5, settled).T_world_rig for settled in (False, True)
    )
    assert np.linalg.norm(se3.log(se3.inverse(right) @ growing)[3:]) > 0.005
    np.testing.assert_allclose(settled, right, atol=1e-6)


@pytest.mark.parametrize("view", range(4))
def test_a_true_one_is_heard_there(view: int) -> None:
    optics = Optics(folded(), 8.0)
    off = []
    for seed in range(10):
        for seen in with_one_elsewhere(optics, view, np.random.default_rng([36, view, seed]), 0.0):
            T = refine_pose(MOVED @ LITTLE, seen, optics, 0.5, settled=True).T_world_rig
            off.append(float(np.linalg.norm(se3.log(se3.inverse(MOVED) @ T)[3:])))
    assert np.median(off[::2]) < 0.8 * np.median(off[1::2])
