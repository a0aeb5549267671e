"""Loops in maps: counted where tracking closes them itself, mended where the map has drifted apart."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from slam_worlds import winding_path

from facetcam.evaluation.trajectory import evaluate
from facetcam.geometry import se3
from facetcam.io.odometry import read_odometry
from facetcam.io.sources import open_source
from facetcam.io.trajectories import read_tum
from facetcam.rig import Rig
from facetcam.slam import Slam
from facetcam.slam.camera.frame import Corners, make_frame
from facetcam.slam.map.common_points import merge_points
from facetcam.slam.map.joining import move_map
from facetcam.slam.map.map import Keyframe, Map
from facetcam.slam.map.places import Places

Array = NDArray[np.float64]


def keyframe(index: int, T_world_rig: Array, points: list[int]) -> Keyframe:
    made = Keyframe(index, float(index), T_world_rig, Corners.none(), None, None)
    ids = np.array(points)
    rows = np.arange(2.0 * len(ids)).reshape(-1, 2)
    made.observations.append(ids, np.zeros(len(ids), np.int8), rows, rows)
    return made


def test_points_move_with_the_keyframe_that_saw_them_first() -> None:
    world, rng = Map(), np.random.default_rng(2)
    xyz = rng.standard_normal((4, 3))
    world.points.extend(xyz=xyz.copy(), tangent=rng.standard_normal((4, 3, 2)))
    tangent = world.points.tangent.copy()
    old = winding_path(2)
    world.keyframes = [keyframe(0, old[0], [0, 1]), keyframe(1, old[1], [1, 2])]
    new = np.array([se3.exp([0.1, 0.2, 0.3, 1, 2, 3]), se3.exp([0, 0, -0.4, 2, 0, 1])])
    move_map(world, new, np.array([1.0, 2.0]))
    for point, k in ((0, 0), (1, 0), (2, 1)):
        seen_before = se3.transform(se3.inverse(old[k]), xyz[point : point + 1])
        seen_after = se3.transform(se3.inverse(new[k]), world.points.xyz[point : point + 1])
        np.testing.assert_allclose(seen_after, (1.0, 2.0)[k] * seen_before, atol=1e-12)
    np.testing.assert_array_equal(world.points.xyz[3], xyz[3])
    turn = new[1, :3, :3] @ old[1, :3, :3].T
    np.testing.assert_allclose(world.points.tangent[2], 2.0 * turn @ tangent[2], atol=1e-12)
    assert [k.scale for k in world.keyframes] == [1.0, 2.0]


def test_merged_points_are_observed_as_one() -> None:
    world = Map()
    world.points.extend(xyz=np.zeros((6, 3)))
    world.keyframes = [keyframe(0, np.eye(4), [0, 1, 2]), keyframe(1, np.eye(4), [3, 4, 0])]
    merge_points(world, Places(), np.array([3, 4]), np.array([0, 1]))
    assert world.keyframes[0].observations.point.tolist() == [0, 1, 2]
    assert world.keyframes[1].observations.point.tolist() == [0, 1]  # point 0 was seen there already
    assert world.points.alive.tolist() == [True, True, True, False, False, True]


def apart(slam: Slam, drift: Array) -> Array:
    """Tear the map open: late keyframes have points of their own, and drift away step by step."""
    keyframes, points = slam._map.keyframes, slam._map.points
    K = len(keyframes)
    early = slam._map.observed_points(keyframes[: K // 4])
    late = slam._map.observed_points(keyframes[K // 2 + 4 :])
    both = np.intersect1d(early, late)
    twins = points.extend(**{n: c[both] for n, c in vars(points).items() if isinstance(c, np.ndarray)})
    for k in keyframes[K // 2 + 4 :]:
        where = np.minimum(np.searchsorted(both, k.observations.point), len(both) - 1)
        hit = both[where] == k.observations.point
        k.observations.point[hit] = twins[where[hit]]
    true = slam._map.poses()
    poses = [true[0]]
    for a, b in pairwise(true):
        poses.append(poses[-1] @ se3.inverse(a) @ b @ drift)
    move_map(slam._map, np.array(poses), np.ones(K))
    return true


@pytest.fixture(scope="module")
def driven(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Slam, Path]:
    house = shared_data / "house"
    slam = Slam(Rig.load(house / "rig_true.yaml"))
    wheels = read_odometry(house / "loop_odometry.csv")
    with open_source(house / "loop.mp4", None) as film:
        for frame in film:
            slam.track(frame.image, frame.timestamp, wheels.at(frame.timestamp))
    slam.finish()
    path = tmp_path_factory.mktemp("loop") / "loop.facetmap"
    slam.save_map(path)
    return slam, path


@pytest.mark.slow
def test_a_drive_back_to_its_start_closes_a_loop(driven: tuple[Slam, Path], shared_data: Path) -> None:
    slam, _ = driven
    assert slam.loops >= 1  # it may be seen to close again further on
    truth = read_tum(shared_data / "house" / "loop.tum")
    assert evaluate(slam.trajectory(), truth, 0.02).ate.rmse < 0.03


@pytest.mark.slow
def test_a_map_that_drifted_apart_is_mended(driven: tuple[Slam, Path], shared_data: Path) -> None:
    slam = Slam(driven[0].rig)
    slam.load_map(driven[1])
    true = apart(slam, se3.exp([0, 0, 0.004, 0.002, 0.003, 0.001]))
    before = np.linalg.norm(slam._map.poses()[:, :3, 3] - true[:, :3, 3], axis=1)
    with open_source(shared_data / "house" / "loop.mp4", None) as film:
        *_, end = film  # it ends where it began
    times, poses = driven[0].trajectory()
    last, parts = slam._map.keyframes[-1], slam._parts
    since = se3.inverse(poses[np.argmin(np.abs(times - last.timestamp))]) @ poses[-1]
    frame = make_frame(end.image, end.timestamp, slam.rig.size)
    fix = parts.tracker.locate(frame, last.T_world_rig @ since)
    assert fix is not None
    keyframe = parts.mapper.insert(frame, fix.T_world_rig, fix.seen, None, slam.config.gate)
    off = np.linalg.norm(keyframe.T_world_rig[:3, 3] - poses[-1][:3, 3])
    loop = parts.loops.close(keyframe, metric=True)
    assert loop is not None and loop.points > 100
    assert loop.gap == pytest.approx(off, abs=0.02)
    slam._parts.adjuster.adjust_coarsely()
    slam._grower.adjust_all()
    after = np.linalg.norm(slam._map.poses()[:-1, :3, 3] - true[:, :3, 3], axis=1)
    assert before.max() > 0.5
    assert after.max() < 0.25 * before.max()
