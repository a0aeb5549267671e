"""Loops that drifted and are closed, against the way that was really driven."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from facetcam.geometry import se3
from facetcam.slam.map.pose_graph import Edges, relax

Array = NDArray[np.float64]


def round_way(count: int) -> Array:
    """Poses (N, 4, 4) once round a circle of 3 m, back to the first one."""
    angle = np.linspace(0.0, 2.0 * np.pi, count)
    poses = np.array([se3.exp([0, 0, a, 0, 0, 0]) for a in angle])
    poses[:, :3, 3] = 3.0 * np.column_stack([np.cos(angle) - 1.0, np.sin(angle), 0.1 * np.sin(2 * angle)])
    return poses


def drifted(way: Array, turn: float, shrink: float) -> Array:
    """The way as seen by one who turns a little too far at each step, and whose steps get shorter."""
    poses, wrong = [way[0]], se3.exp([0, 0, turn, 0, 0, 0])
    for k in range(1, len(way)):
        step = se3.inverse(way[k - 1]) @ way[k]
        step[:3, 3] *= (1.0 - shrink) ** k
        poses.append(poses[-1] @ step @ wrong)
    return np.array(poses)


@pytest.mark.parametrize(("shrink", "with_scale"), [(0.0, False), (0.004, True)])
def test_a_closed_loop_lies_where_it_was_driven(shrink: float, with_scale: bool) -> None:
    way = round_way(60)
    poses = drifted(way, 0.002, shrink)
    i = np.arange(59)
    last = (1.0 - shrink) ** 59
    edges = Edges.between(i, i + 1, poses).plus(0, 59, np.eye(4), 1.0 / last, 5.0)
    closed, growth = relax(poses, edges, with_scale)
    np.testing.assert_array_equal(closed[0], poses[0])
    before, after = (np.linalg.norm(p[:, :3, 3] - way[:, :3, 3], axis=1) for p in (poses, closed))
    assert np.linalg.norm(closed[-1, :3, 3] - way[-1, :3, 3]) < 0.02 < 0.2 < before[-1]
    assert after.max() < 0.35 * before.max()
    if with_scale:
        expected = (1.0 - shrink) ** -np.arange(60.0)
        assert np.abs(growth / expected - 1.0).max() < 0.05 < np.abs(expected - 1.0).max()
    else:
        np.testing.assert_array_equal(growth, np.ones(60))
    for T in closed:
        se3.assert_proper_rotation(T[:3, :3])


def test_a_graph_that_agrees_stays_as_it_is() -> None:
    way = round_way(20)
    i = np.arange(19)
    edges = Edges.between(i, i + 1, way).plus(0, 19, se3.inverse(way[0]) @ way[19], 1.0, 5.0)
    closed, growth = relax(way, edges, with_scale=True)
    np.testing.assert_allclose(closed, way, atol=1e-9)
    np.testing.assert_allclose(growth, 1.0, atol=1e-9)


def test_a_single_pose_has_nothing_to_close() -> None:
    nothing = np.empty(0, np.int64)
    poses, growth = relax(np.eye(4)[None], Edges.between(nothing, nothing, np.eye(4)[None]), True)
    assert poses.shape == (1, 4, 4) and growth.tolist() == [1.0]
