"""What tracking keeps: wheel motions, the trajectory, map points, frames."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from slam_worlds import folded, in_sight, look, winding_path

from facetcam.errors import FacetcamError
from facetcam.geometry import se3
from facetcam.simulation.drive import round_the_table, wheel_odometry
from facetcam.slam import Slam, Status
from facetcam.slam.camera.frame import Corners, Frame, make_frame
from facetcam.slam.camera.optics import Optics
from facetcam.slam.map.map import Keyframe, Map, Observations
from facetcam.slam.map.measure import Measurements
from facetcam.slam.map.points import Points
from facetcam.slam.map.trajectory import Trajectory
from facetcam.slam.odometry.planar import planar_motion, planar_pose
from facetcam.slam.tracking.motion import Motion
from facetcam.slam.tracking.trust import Reckoning

Array = NDArray[np.float64]

NOTHING = Corners.none()


def keyframe(index: int, T_world_rig: Array) -> Keyframe:
    return Keyframe(index, float(index), T_world_rig, NOTHING, None, None)


def moved(*twist: float) -> Array:
    return se3.exp(twist)


def test_wheels_that_roll_ahead_move_the_rig_to_its_front() -> None:
    T, _ = planar_motion(np.array([1.0, 2.0, 0.7]), np.array([1 + np.cos(0.7), 2 + np.sin(0.7), 0.7]), 0.1)
    np.testing.assert_allclose(T, moved(0, 0, 0, 0, 1, 0), atol=1e-12)


def test_a_turn_to_the_left_is_a_turn_about_up() -> None:
    T, _ = planar_motion(np.array([3.0, -1.0, 3.0]), np.array([3.0, -1.0, 3.5]), 0.1)
    np.testing.assert_allclose(T, moved(0, 0, 0.5, 0, 0, 0), atol=1e-12)
    aside, _ = planar_motion(np.zeros(3), np.array([0.0, 0.4, 0.0]), 0.1)
    np.testing.assert_allclose(aside[:3, 3], [-0.4, 0.0, 0.0], atol=1e-12)


def test_faultless_wheels_give_the_motion_of_the_drive() -> None:
    drive = round_the_table(30)
    wheels = wheel_odometry(drive, scale_error=0.0, yaw_drift=0.0, noise=0.0)
    for k in range(29):
        T, _ = planar_motion(wheels[k], wheels[k + 1], 0.1)
        np.testing.assert_allclose(T, se3.inverse(drive.poses[k]) @ drive.poses[k + 1], atol=1e-9)


def test_planar_poses_stand_on_the_floor_and_look_along_the_yaw() -> None:
    T = planar_pose(np.array([0.3, -0.4, 0.6]))
    np.testing.assert_allclose(T[:3, 3], [0.3, -0.4, 0.0])
    np.testing.assert_allclose(T[:3, :3] @ [0, 1, 0], [np.cos(0.6), np.sin(0.6), 0.0], atol=1e-12)
    np.testing.assert_allclose(T[:3, :3] @ [0, 0, 1], [0, 0, 1], atol=1e-12)


def test_wheels_are_trusted_less_over_longer_ways() -> None:
    near, far = (planar_motion(np.zeros(3), np.array([d, 0.0, 0.0]), 0.3)[1] for d in (0.1, 1.0))
    assert np.all(np.linalg.eigvalsh(near) > 0)
    assert np.all(np.diag(far)[3:] > np.diag(near)[3:])
    assert np.sqrt(far[3, 3]) == pytest.approx(0.3, rel=0.05)


def test_frames_follow_their_keyframe() -> None:
    hung = keyframe(0, moved(0, 0, 0.3, 1, 2, 0))
    pose = moved(0, 0, 0.5, 1.4, 2.2, 0.1)
    trajectory = Trajectory()
    trajectory.add(4.0, pose, hung)
    np.testing.assert_allclose(trajectory.poses()[1][0], pose, atol=1e-12)
    shift = moved(0.1, -0.2, 0.4, 0.5, 0.1, -0.3)
    hung.T_world_rig = shift @ hung.T_world_rig
    np.testing.assert_allclose(trajectory.poses()[1][0], shift @ pose, atol=1e-12)


def test_frames_follow_the_scale_of_their_keyframe() -> None:
    """A map that doubles about the origin doubles the frame's place, whenever it was added."""
    hung = keyframe(0, moved(0, 0, 0.3, 1, 2, 0))
    hung.scale = 1.5
    pose = moved(0, 0, 0.5, 1.4, 2.2, 0.1)
    trajectory = Trajectory()
    trajectory.add(4.0, pose, hung)
    hung.T_world_rig = hung.T_world_rig.copy()
    hung.T_world_rig[:3, 3] *= 2.0
    hung.scale *= 2.0
    (after,) = trajectory.poses()[1]
    np.testing.assert_allclose(after[:3, 3], 2.0 * pose[:3, 3], atol=1e-12)
    np.testing.assert_allclose(after[:3, :3], pose[:3, :3], atol=1e-12)


def test_poses_are_found_again_from_what_frames_saw() -> None:
    """Frames were placed in a map that was wrong; of the last one the map has lost nearly all points."""
    optics, rng, path = Optics(folded(), 8.0), np.random.default_rng(5), winding_path(5)
    points, wrong = in_sight(optics, path, rng, 1500), moved(0.01, -0.02, 0.01, 0.05, -0.03, 0.04)
    hung, trajectory = keyframe(0, path[0]), Trajectory()
    for time, T in enumerate(path):
        seen = look(optics, T, points[300 * time : 300 * time + 300])
        found = Measurements(seen.point + 300 * time, seen.view, seen.pixels, seen.plane)
        trajectory.add(0.1 * time, T @ wrong, hung, found)
    world = mapped(points)
    world.points.alive[4 * 300 + 8 :] = False
    trajectory.solve_again(world, optics, 0.5)
    np.testing.assert_allclose(trajectory.poses()[1][:4], path[:4], atol=1e-5)
    np.testing.assert_allclose(trajectory.last(), path[4] @ wrong, atol=1e-12)
    hung.T_world_rig = wrong @ hung.T_world_rig  # found again, they still follow the map
    np.testing.assert_allclose(trajectory.poses()[1][2], wrong @ path[2], atol=1e-5)


def before_views(
    optics: Optics, views: NDArray[np.int8], away: Array, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Points (N, 3) so many metres before views (N,) of a rig at the origin, and the raw pixels of them."""
    pixels = np.array([rng.permutation(np.argwhere(optics.labels == v)[:, ::-1])[0] for v in views], float)
    rays = optics.rays(pixels, views)
    depth = np.einsum("nj,nj->n", rays, optics.T_rig_view[views][:, :3, 2])
    return optics.origins(views) + (away / depth)[:, None] * rays, pixels


@pytest.mark.parametrize("view", range(4))
def test_in_the_end_a_lone_point_that_others_deny_moves_no_pose(view: int) -> None:
    """One of another view, found by chance, before a wall that hardly tells a step from a turn."""
    optics, rng = Optics(folded(), 8.0), np.random.default_rng([33, view])
    views = np.append(np.full(90, view), (view + 1) % 4).astype(np.int8)
    points, pixels = before_views(optics, views, np.append(np.full(90, 7.0), 2.0), rng)
    pixels[:90] += rng.normal(0.0, 0.15, (90, 2))
    hung, poses = keyframe(0, np.eye(4)), []
    for kept, off in ((91, 0.03), (90, 0.0)):
        world, trajectory = mapped(points + [[off, off, off]] * (np.arange(91) == 90)[:, None]), Trajectory()
        seen = Measurements(np.arange(kept), views[:kept], pixels[:kept], pixels[:kept])
        trajectory.add(0.0, np.eye(4), hung, seen)
        trajectory.solve_again(world, optics, 0.5)
        poses.append(trajectory.last())
    np.testing.assert_allclose(poses[0], poses[1], atol=1e-6)


def mapped(points: Array) -> Map:
    """A map of points that are corners."""
    world = Map()
    world.points.extend(xyz=points)
    return world


def rolled(optics: Optics, T: Array, twist: Array, readout: float, points: Array) -> Measurements:
    """What a rig that moves by a twist a second sees of points while its rows are read one by one."""
    seen, height = look(optics, T, points), optics.camera.height
    pixels = seen.pixels.copy()
    for _ in range(3):
        late = readout * (pixels[:, 1] / (height - 1) - 0.5)
        for row, (point, view, time) in enumerate(zip(seen.point, seen.view, late)):
            place = se3.transform(se3.inverse(T @ se3.exp(time * twist)), points[[point]])
            pixels[row] = optics.rig.project(optics.names[view], place)[0][0]
    return Measurements(seen.point, seen.view, pixels, seen.plane)


def test_poses_behind_a_rolling_shutter_are_those_of_the_middle_row_however_long_ago() -> None:
    optics, rng, twist = Optics(folded(), 8.0), np.random.default_rng(6), np.array([0, 0, 0.3, 0.2, 0.8, 0])
    path = [se3.exp(0.1 * k * twist) for k in range(5)]
    points, hung, trajectory = in_sight(optics, np.array(path), rng, 300), keyframe(0, path[0]), Trajectory()
    for time, T in enumerate(path):
        trajectory.add(0.1 * time, T, hung, rolled(optics, T, twist, 0.03, points))
    for time in range(5, 1200):
        trajectory.add(0.1 * time, path[-1], hung)
    world = mapped(points)
    world.readout = 0.03
    trajectory.solve_again(world, optics, 0.5)
    np.testing.assert_allclose(trajectory.poses()[1][1:4], path[1:4], atol=1e-3)
    world.readout = 0.0
    trajectory.solve_again(world, optics, 0.5)
    assert np.abs(trajectory.poses()[1][1:4] - path[1:4]).max() > 2e-3  # a shutter taken for a global one


def test_poses_come_in_the_order_of_time() -> None:
    trajectory, hung = Trajectory(), keyframe(0, np.eye(4))
    for time in (3.0, 1.0, 2.0):
        trajectory.add(time, moved(0, 0, 0, time, 0, 0), hung)
    times, poses = trajectory.poses()
    assert times.tolist() == [1.0, 2.0, 3.0]
    np.testing.assert_allclose(poses[:, 0, 3], times)
    trajectory.clear()
    assert [len(part) for part in trajectory.poses()] == [0, 0]


def test_points_keep_their_rows_while_they_grow() -> None:
    rng, points, blocks = np.random.default_rng(31), Points(), []
    for count in (700, 0, 900, 3000):
        block = rng.standard_normal((count, 3))
        ids = points.extend(xyz=block, colour=np.full((count, 3), len(blocks), np.uint8))
        assert ids.tolist() == list(range(len(points) - count, len(points)))
        blocks.append(block)
        points.found[:5] += 1
    assert len(points) == 4600
    np.testing.assert_array_equal(points.xyz, np.concatenate(blocks))
    assert points.colour[:, 0].tolist() == [0] * 700 + [2] * 900 + [3] * 3000
    assert points.alive.all() and not points.predicted.any()
    assert points.found[:6].tolist() == [4, 4, 4, 4, 4, 0]


def test_near_keyframes_and_their_living_points() -> None:
    world = Map()
    world.points.extend(xyz=np.zeros((6, 3)))
    for k, place in enumerate((5.0, 1.0, 3.0)):
        world.keyframes.append(keyframe(k, moved(0, 0, 0, place, 0, 0)))
        ids = np.array([k, k + 2, 5])
        world.keyframes[-1].observations.append(ids, np.zeros(3, np.int8), np.zeros((3, 2)), np.zeros((3, 2)))
    near = world.near(np.array([0.0, 0.0, 0.0]), 2)
    assert [k.index for k in near] == [1, 2]
    assert [k.index for k in world.covisible(np.array([2, 3, 4]), world.keyframes)] == [2, 0, 1]
    assert world.covisible(np.array([1]), near) == [near[0]]
    world.points.alive[3] = False
    assert world.observed_points(near).tolist() == [1, 2, 4, 5]
    world.clear()
    assert world.near(np.zeros(3), 2) == [] and len(world.observed_points([])) == 0


def test_observations_know_point_and_view_together() -> None:
    seen = Observations()
    seen.append(np.array([3, 3, 7]), np.int8([0, 2, 1]), np.zeros((3, 2)), np.arange(6.0).reshape(3, 2))
    assert seen.has(np.array([3, 3, 7, 0]), np.int8([2, 1, 1, 0])).tolist() == [True, False, True, False]
    seen.keep(np.array([False, True, True]))
    assert (seen.point.tolist(), seen.view.tolist()) == ([3, 7], [2, 1])
    assert seen.plane.tolist() == [[2.0, 3.0], [4.0, 5.0]]


@pytest.mark.parametrize("shape", [(48, 64), (48, 64, 3)])
def test_frames_of_16_bit_are_those_of_8_bit(shape: tuple[int, ...]) -> None:
    image = np.random.default_rng(32).integers(0, 256, shape).astype(np.uint8)
    narrow, wide = make_frame(image, 0.0, (64, 48)), make_frame(image.astype(np.uint16) * 257, 0.0, (64, 48))
    assert np.array_equal(narrow.grey, wide.grey)
    blocks = narrow.grey.reshape(24, 2, 32, 2).astype(float).mean(axis=(1, 3))
    assert np.abs(narrow.half - blocks).max() <= 0.5


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((48, 65), np.uint8),
        np.zeros((48, 64), np.float32),
        np.zeros((48, 64, 3), np.int16),
        np.zeros((48, 64, 2), np.uint8),
        np.zeros((48, 64, 3, 1), np.uint8),
        np.zeros(48, np.uint8),
    ],
    ids=["size", "float", "int16", "two channels", "four axes", "one axis"],
)
def test_what_is_no_frame_is_refused_in_one_line(image: NDArray) -> None:
    with pytest.raises(FacetcamError) as caught:
        make_frame(image, 1.5, (64, 48))
    assert "\n" not in str(caught.value)
    assert "1.500 s" in str(caught.value)


def test_a_way_of_wheels_is_bent_to_where_sight_found_the_rig_again() -> None:
    step, drift = moved(0, 0, 0.1, 0, 0.2, 0), moved(0, 0, 0.01, 0.002, 0.004, 0)
    true = [np.linalg.matrix_power(step, k) for k in range(12)]
    first = keyframe(0, np.eye(4))
    trajectory = Trajectory()
    trajectory.add(0.0, true[0], first)
    for k in range(1, 11):  # wheels that turn and go too far, the same in each step
        trajectory.add(k, trajectory.last() @ step @ drift, first, T_before=step @ drift)
    trajectory.add(11.0, true[11], keyframe(11, true[11]), T_before=step @ drift)
    before = np.linalg.norm(trajectory.poses()[1][:, :3, 3] - np.array(true)[:, :3, 3], axis=1)
    trajectory.close_gaps()
    after = np.linalg.norm(trajectory.poses()[1][:, :3, 3] - np.array(true)[:, :3, 3], axis=1)
    assert before.max() > 0.07
    assert after.max() < 0.01


def test_a_way_of_wheels_without_an_end_in_sight_stays() -> None:
    step = moved(0, 0, 0.1, 0, 0.2, 0)
    trajectory = Trajectory()
    trajectory.add(0.0, np.eye(4), keyframe(0, np.eye(4)))
    for k in range(1, 4):
        trajectory.add(k, trajectory.last() @ step, keyframe(0, np.eye(4)), T_before=step)
    before = trajectory.poses()[1]
    trajectory.close_gaps()
    np.testing.assert_array_equal(trajectory.poses()[1], before)


def lost(followed: float, waited: float, keyframes: int) -> tuple[Slam, Frame]:
    """A rig that was followed for some seconds, then lost, and its next frame."""
    slam = Slam(folded())
    slam._map.keyframes = [keyframe(k, np.eye(4)) for k in range(keyframes)]
    for t in np.arange(0.0, followed + 0.05, 0.1):
        slam._motion.trajectory.add(float(t), np.eye(4), slam._map.keyframes[0])
    slam._motion.lost_frames = round(10 * waited)
    width, height = slam.rig.size
    return slam, make_frame(np.zeros((height, width), np.uint8), followed + waited, slam.rig.size)


@pytest.mark.parametrize("waited", [0.7, 60.0])
def test_a_map_is_kept_however_long_it_is_not_seen(waited: float) -> None:
    slam, frame = lost(20.0, waited, 30)
    state = slam.track(frame.grey, frame.timestamp)  # in the dark nothing begins
    assert state.status is Status.LOST
    assert len(slam.trajectory()[0]) == 201
    assert not slam.trajectories_apart()


def test_a_young_map_that_was_lost_is_forgotten() -> None:
    slam, frame = lost(20.0, 1.5, 7)
    assert slam.track(frame.grey, frame.timestamp).status is Status.STARTING
    assert not len(slam.trajectory()[0])


def test_a_loaded_map_is_never_forgotten() -> None:
    slam, frame = lost(2.0, 5.0, 7)
    slam._loop.go_on(localise_only=False)
    assert slam.track(frame.grey, frame.timestamp).status is Status.LOST


@pytest.mark.parametrize(("way", "status"), [(0.0, Status.LOST), (0.5, Status.DEAD_RECKONING)])
def test_a_rig_that_is_carried_while_its_wheels_stand_is_lost(way: float, status: Status) -> None:
    """Six frames showed enough, and nothing of the map, where the wheels say that the rig has not moved."""
    slam, frame = lost(20.0, 0.7, 30)
    motion, resumer, width = slam._motion, slam._parts.resumer, slam.rig.size[0]
    motion.placed, motion.odometry = True, np.zeros(3)
    motion._reckoning, resumer._in_vain = Reckoning(np.eye(4), way=way), 6
    grid = np.indices((slam.rig.size[1], width)).sum(axis=0) // 20 % 2  # something to see
    state = slam.track((255 * grid).astype(np.uint8), frame.timestamp, np.zeros(3))
    assert state.status is status
    assert (state.T_world_rig is None) == (status is Status.LOST)
    seen = 201
    assert len(slam.trajectory()[0]) == (seen if status is Status.LOST else seen + 1)
    assert (motion.roll(frame.timestamp + 0.1, np.zeros(3), 0.3, keyframe(0, np.eye(4))) is None) == (
        way == 0
    )


def test_poses_that_were_wrong_are_forgotten_back_to_the_last_keyframe() -> None:
    motion, base = Motion(), keyframe(1, moved(0, 0, 0.1, 0, 1, 0))
    base.odometry = np.array([1.0, 0.0, 0.0])
    for t in (0.9, 1.0, 1.1, 1.2):
        motion.trajectory.add(t, moved(0, 0, 0, 0, t, 0), base)
    motion.placed, motion.odometry = True, np.array([1.2, 0.0, 0.0])
    motion.go_back(base)
    assert motion.trajectory.last_timestamp == 1.0
    wheels, _ = motion.predictions(1.3, np.array([1.5, 0.0, 0.0]))  # half a metre since the keyframe
    np.testing.assert_allclose(wheels, moved(0, 0, 0, 0, 1.5, 0), atol=1e-9)
