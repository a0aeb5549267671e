"""Sight and wheels together, against the weighted mean and against a wall that one view sees."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from slam_worlds import by_wheels, folded, look, spoiled

from facetcam.geometry import se3
from facetcam.slam.camera.optics import Optics
from facetcam.slam.camera.pose import Pose
from facetcam.slam.relative_pose.confirmed_motion import confirmed_motion
from facetcam.slam.relative_pose.pairs import Pairs
from facetcam.slam.relative_pose.two_frames import polished
from facetcam.slam.tracking.fusion import fused
from facetcam.slam.tracking.uncertainty import TOGETHER

Array = NDArray[np.float64]

SIGMAS = np.array([0.02, 0.03, 0.01, 0.05, 0.2, 0.01])


def seen(sigmas: Array) -> Pose:
    return Pose(se3.exp([0.1, 0.0, 0.4, 1.0, 2.0, 0.0]), np.diag(sigmas**2) / TOGETHER, np.zeros(0))


@pytest.mark.parametrize("axis", range(6))
def test_one_number_is_the_weighted_mean(axis: int) -> None:
    pose, told = seen(SIGMAS), 2.0 * SIGMAS
    off = np.zeros(6)
    off[axis] = 1.5 * SIGMAS[axis]
    both = fused(pose, pose.T_world_rig @ se3.exp(off), np.diag(told**2))
    weights = 1.0 / SIGMAS[axis] ** 2, 1.0 / told[axis] ** 2
    moved = se3.log(se3.inverse(pose.T_world_rig) @ both.T_world_rig)
    np.testing.assert_allclose(moved, off * weights[1] / sum(weights), atol=1e-12)
    assert both.covariance[axis, axis] * TOGETHER == pytest.approx(1.0 / sum(weights))


def test_what_sight_tells_is_kept_and_what_it_cannot_comes_from_the_wheels() -> None:
    rng = np.random.default_rng(90)
    blind = np.where(np.arange(6) == 4, 10.0, 1e-4)  # the way ahead
    for off in rng.normal(0.0, [0.01, 0.01, 0.01, 0.02, 0.3, 0.02], (20, 6)):
        pose = seen(blind)
        T = fused(pose, pose.T_world_rig @ se3.exp(off), np.diag([0.1, 0.1, 0.02, 0.1, 0.1, 0.1]) ** 2)
        moved = se3.log(se3.inverse(pose.T_world_rig) @ T.T_world_rig)
        assert abs(moved[4] - off[4]) < 0.01
        assert np.abs(np.delete(moved, 4)).max() < 1e-3
        assert np.linalg.eigvalsh(pose.covariance - T.covariance).min() > -1e-12


def test_wheels_that_slip_are_left_out() -> None:
    pose = seen(np.full(6, 0.01))
    assert fused(pose, pose.T_world_rig @ se3.exp([0, 0, 0, 0, 0.5, 0]), np.eye(6) * 1e-4) is pose


def far_wall(optics: Optics, T_a_b: Array, rng: np.random.Generator) -> Pairs:
    """A picture on a wall seven metres beside the rig, in the view to the right, and nothing else."""
    points = np.column_stack([np.full(900, 7.0), rng.uniform(-1.2, 1.2, 900), rng.uniform(-0.2, 1.2, 900)])
    a, b = (look(optics, T, points) for T in (np.eye(4), T_a_b))
    _, rows_a, rows_b = np.intersect1d(a.point * 8 + a.view, b.point * 8 + b.view, return_indices=True)
    keep = rng.choice(len(rows_a), min(90, len(rows_a)), replace=False)
    pairs = Pairs(a.view[rows_a], a.plane[rows_a], b.plane[rows_b])
    return Pairs(pairs.views[keep], pairs.plane_a[keep], pairs.plane_b[keep])


def test_a_wall_that_one_view_sees_leaves_the_turn_to_the_wheels() -> None:
    optics = Optics(folded(), 8.0)
    true = se3.exp([0.0, 0.0, -0.1, 0.0, 0.11, 0.0])
    wheels = true @ se3.exp([0.0, 0.0, 0.004, 0.0, 0.004, 0.0])
    by_sight, by_both = [], []
    for seed in range(20):
        rng = np.random.default_rng([91, seed])
        pairs = spoiled(far_wall(optics, true, rng), optics, rng, 0.05, 0.3)
        assert len(np.unique(pairs.views)) == 1
        T = confirmed_motion(pairs, by_wheels(wheels), optics)
        assert T is not None
        for found, turns in ((polished(wheels, pairs, optics), by_sight), (T, by_both)):
            turns.append(np.degrees(np.linalg.norm(se3.log(se3.inverse(true) @ found)[:3])))
    assert np.median(by_sight) > 0.7
    assert np.median(by_both) < 0.4
