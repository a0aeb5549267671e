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
from facetcam.slam.optics import Optics
from facetcam.slam.pose import generalized_pose, linearise, refine_pose

Array = NDArray[np.float64]

TRUE = se3.exp([0.04, -0.06, 0.9, 0.3, -0.2, 0.1])
NEAR = TRUE @ se3.exp([0.03, -0.02, 0.04, 0.05, -0.04, 0.03])


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
    args = points[seen.point], seen.view, seen.plane, optics
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
    pose = refine_pose(NEAR, points[seen.point], seen.view, plane, optics, 0.5)
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
    pose = refine_pose(TRUE, place, seen.view, seen.plane, optics, 0.5)
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
        pose = refine_pose(NEAR, points[seen.point], seen.view, plane, optics, 0.5)
        twist = se3.log(se3.inverse(pose.T_world_rig) @ TRUE)
        squares.append(twist @ np.linalg.solve(pose.covariance, twist))
    low, high = chi2.ppf([1e-4, 1 - 1e-4], 6 * trials)
    # The robust kernel weighs good measurements down, which costs up to twice the variance.
    assert low < np.sum(squares) < 2.0 * high


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
    found = refine_pose(start, xyz, sight.view, plane, optics, sigma).T_world_rig
    assert cost(found) < cost(start)
    for axis in np.eye(6):
        for step in (1e-4, -1e-4):
            assert cost(found @ se3.exp(step * axis)) > cost(found)
