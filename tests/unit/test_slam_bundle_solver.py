"""The native bundle adjuster against Ceres, and against itself on other numbers of threads."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from ceres_bundle import ceres_adjust
from numpy.typing import NDArray
from slam_worlds import bundle_of, folded, in_sight, winding_path

from facetcam.geometry import se3
from facetcam.slam.adjustment.bundle import Bundle, RelativePose, adjust
from facetcam.slam.camera.nuisances import Nuisances
from facetcam.slam.camera.optics import Optics

Array = NDArray[np.float64]

PATH = winding_path(6)
LOSS = 1.0


@pytest.fixture(scope="module")
def ryu() -> Optics:
    return Optics(folded(), 8.0)


@pytest.fixture(scope="module")
def noisy(ryu: Optics) -> Bundle:
    """A start off the minimum, with noise and wrong matches."""
    rng = np.random.default_rng(41)
    bundle = bundle_of(ryu, PATH, in_sight(ryu, PATH, rng, 900), rng.normal(0.0, 0.4, (20000, 2)))
    bundle.plane[::25] += 20.0
    for k in range(1, len(PATH)):
        bundle.T_world_rig[k] = bundle.T_world_rig[k] @ se3.exp(0.01 * rng.standard_normal(6))
    bundle.points = bundle.points + 0.01 * rng.standard_normal(bundle.points.shape)
    return bundle


def cost(bundle: Bundle, optics: Optics, T_world_rig: Array, points: Array) -> float:
    """Half the sum of Cauchy losses, observation by observation, as the definition says."""
    total = 0.0
    for k, T in enumerate(T_world_rig):
        rows = bundle.frame == k
        plane, depth = optics.to_plane(
            se3.transform(se3.inverse(T), points[bundle.point[rows]]), bundle.view[rows]
        )
        assert np.all(depth > 0)
        squared = np.sum((plane - bundle.plane[rows]) ** 2, axis=1)
        total += 0.5 * float(np.sum(LOSS**2 * np.log1p(squared / LOSS**2)))
    for m in bundle.motions:
        E = se3.inverse(m.T_i_j) @ se3.inverse(T_world_rig[m.i]) @ T_world_rig[m.j]
        error = np.concatenate([se3.log(E)[:3], E[:3, 3]])
        squared = float(error @ np.linalg.solve(m.covariance, error))
        scale2 = m.loss_scale**2
        total += 0.5 * (squared if np.isinf(scale2) else scale2 * np.log1p(squared / scale2))
    return total


def test_same_minimum_as_ceres(ryu: Optics, noisy: Bundle) -> None:
    ours, theirs = adjust(noisy, ryu, LOSS, 100, 1e-13), ceres_adjust(noisy, ryu, LOSS, 100, 1e-13)
    assert np.abs(noisy.T_world_rig - theirs[0]).max() > 0.01
    np.testing.assert_allclose(ours[0], theirs[0], atol=2e-5)
    assert np.median(np.abs(ours[1] - theirs[1])) < 1e-5
    assert cost(noisy, ryu, *ours[:2]) == pytest.approx(cost(noisy, ryu, *theirs), rel=1e-6)


def test_same_minimum_as_ceres_with_odometry_between_the_frames(ryu: Optics, noisy: Bundle) -> None:
    """One covariance for all axes, so that both ways of writing the error mean the same."""
    pulled = replace(noisy, motions=[])
    for k in range(len(PATH) - 1):
        T = se3.inverse(PATH[k]) @ PATH[k + 1]
        T[:3, 3] *= 1.05
        pulled.motions.append(RelativePose(k, k + 1, T, 1e-4 * np.eye(6)))
    ours, theirs = adjust(pulled, ryu, LOSS, 100, 1e-13), ceres_adjust(pulled, ryu, LOSS, 100, 1e-13)
    free = adjust(noisy, ryu, LOSS, 100, 1e-13)
    assert np.abs(ours[0] - free[0]).max() > 1e-3
    np.testing.assert_allclose(ours[0], theirs[0], atol=2e-5)


def test_no_small_move_lowers_the_cost(ryu: Optics, noisy: Bundle) -> None:
    """Odometry that pulls hard, with a covariance of its own on each axis and a robust loss."""
    rng = np.random.default_rng(42)
    A = 0.02 * rng.standard_normal((6, 6))
    T = se3.inverse(PATH[1]) @ PATH[4] @ se3.exp([0.05, -0.1, 0.2, 0.1, 0.0, 0.05])
    bundle = replace(noisy, motions=[RelativePose(4, 1, se3.inverse(T), A @ A.T + 1e-5 * np.eye(6), 3.0)])
    poses, points, _ = adjust(bundle, ryu, LOSS, 200, 1e-15)
    least = cost(bundle, ryu, poses, points)
    for k in range(1, len(PATH)):
        for axis in range(6):
            for step in (1e-4, -1e-4):
                moved = poses.copy()
                moved[k] = moved[k] @ se3.exp(step * np.eye(6)[axis])
                assert cost(bundle, ryu, moved, points) > least
    assert cost(bundle, ryu, poses, points + 1e-4 * rng.standard_normal(points.shape)) > least


def with_nuisances(bundle: Bundle) -> Bundle:
    """With numbers that shift all observations at once, at one that is far from their true one."""
    rng = np.random.default_rng(43)
    by = rng.normal(0.0, 1.0, (len(bundle.frame), 2, 3))
    values, sigma = np.array([0.7, -0.4, 0.0]), np.array([0.5, 5.0, 0.2])
    return replace(bundle, plane=bundle.plane - by @ values, nuisances=Nuisances(values, sigma, by))


def test_nuisances_settle_with_the_map(ryu: Optics, noisy: Bundle) -> None:
    """At the minimum over poses, points and nuisances no small move of these lowers the cost."""
    bundle = with_nuisances(noisy)
    poses, points, found = adjust(bundle, ryu, LOSS, 300, 1e-15)
    assert np.abs(found).max() < 0.02  # the images show that there are none
    assert bundle.nuisances is not None

    def whole_cost(values: Array) -> float:
        nuisances = bundle.nuisances
        assert nuisances is not None
        plane = bundle.plane - nuisances.by @ (values - nuisances.values)
        prior = 0.5 * LOSS**2 * float(np.sum((values / nuisances.sigma) ** 2))
        return prior + cost(replace(bundle, plane=plane), ryu, poses, points)

    least = whole_cost(found)
    for step in 1e-4 * np.concatenate([np.eye(3), -np.eye(3)]):
        assert whole_cost(found + step) > least
    held = replace(noisy, plane=bundle.plane - bundle.nuisances.by @ (found - bundle.nuisances.values))
    np.testing.assert_allclose(poses, adjust(held, ryu, LOSS, 300, 1e-15)[0], atol=2e-6)


def test_a_nuisance_of_no_effect_stays(ryu: Optics, noisy: Bundle) -> None:
    nuisances = Nuisances(np.zeros(1), np.ones(1), np.ones((len(noisy.frame), 2, 1)))
    held = replace(noisy, nuisances=nuisances.believed())
    ours, theirs = (adjust(b, ryu, LOSS, 20, 1e-9) for b in (held, noisy))
    assert np.array_equal(ours[2], [0.0]) and len(theirs[2]) == 0
    np.testing.assert_allclose(ours[0], theirs[0], atol=1e-9)


@pytest.mark.parametrize("threads", [2, 3, 7])
def test_any_number_of_threads_gives_the_same_bits(ryu: Optics, noisy: Bundle, threads: int) -> None:
    for bundle in (noisy, with_nuisances(noisy)):
        one, more = adjust(bundle, ryu, LOSS, 8, 1e-9, 1), adjust(bundle, ryu, LOSS, 8, 1e-9, threads)
        assert all(np.array_equal(a, b) for a, b in zip(one, more))


def test_a_robust_motion_lets_a_slip_go(ryu: Optics, noisy: Bundle) -> None:
    slip = se3.inverse(PATH[0]) @ PATH[-1]
    slip[:3, 3] += 2.0
    free = adjust(noisy, ryu, LOSS, 100, 1e-12)[0]
    stiff, robust = (
        adjust(
            replace(noisy, motions=[RelativePose(0, 5, slip, 1e-4 * np.eye(6), s)]), ryu, LOSS, 200, 1e-12
        )[0]
        for s in (np.inf, 1.0)
    )
    assert np.abs(stiff[5, :3, 3] - free[5, :3, 3]).max() > 0.01
    assert (
        np.abs(robust[5, :3, 3] - free[5, :3, 3]).max() < 0.2 * np.abs(stiff[5, :3, 3] - free[5, :3, 3]).max()
    )


def test_points_and_frames_that_nothing_holds_stay(ryu: Optics, noisy: Bundle) -> None:
    """A point behind every view, a point never seen, a frame that saw nothing."""
    lone = replace(
        noisy,
        T_world_rig=np.concatenate([noisy.T_world_rig, PATH[-1:]]),
        fixed=np.append(noisy.fixed, False),
        points=np.concatenate([noisy.points, [[9.0, 9.0, 9.0]]]),
    )
    poses, points, _ = adjust(lone, ryu, LOSS, 20, 1e-9)
    np.testing.assert_allclose(poses[-1], PATH[-1], atol=1e-12)
    np.testing.assert_array_equal(points[-1], [9.0, 9.0, 9.0])
    assert np.all(np.isfinite(poses)) and np.all(np.isfinite(points))


def test_wrong_indices_are_refused(ryu: Optics, noisy: Bundle) -> None:
    with pytest.raises(ValueError, match="point: an index is out of range"):
        adjust(replace(noisy, points=noisy.points[:-1]), ryu, LOSS, 1, 1e-6)
    with pytest.raises(ValueError, match="one row an observation"):
        adjust(replace(noisy, view=noisy.view[:-1]), ryu, LOSS, 1, 1e-6)
