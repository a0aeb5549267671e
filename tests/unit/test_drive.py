"""The robot's drive and its wheels."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from facetcam.geometry import se3
from facetcam.simulation.drive import Drive, SmoothPath, round_the_table, wheel_odometry
from facetcam.simulation.room import LENGTH, WIDTH, furnished_room


def test_the_drive_is_smooth_proper_and_faces_where_it_goes() -> None:
    drive = round_the_table(110)
    steps = np.diff(drive.poses[:, :3, 3], axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    assert lengths[0] < 0.02 < 0.07 < lengths[20:].min()
    assert lengths.max() < 0.08
    fronts = drive.poses[:-1, :3, 1]
    assert np.einsum("ij,ij->i", fronts, steps).min() > 0
    assert np.all(np.einsum("ij,ij->i", fronts, steps)[5:] > 0.99 * lengths[5:])
    for pose in drive.poses:
        se3.assert_proper_rotation(pose[:3, :3])
    assert np.all(np.abs(drive.poses[:, :2, 3]) < [LENGTH / 2 - 1.4, WIDTH / 2 - 1.4])


def test_bumps_lift_and_pitch_the_rig() -> None:
    flat, rough = round_the_table(110), round_the_table(110, bumps=0.02)
    assert np.ptp(flat.poses[:, 2, 3]) == 0.0
    assert 0.01 < np.ptp(rough.poses[:, 2, 3]) <= 0.02
    assert np.allclose(flat.poses[:, :2, 3], rough.poses[:, :2, 3])
    assert 0.01 < np.abs(rough.poses[:, 2, 1]).max() < 0.2


def test_faultless_wheels_report_the_path() -> None:
    drive = round_the_table(60)
    odometry = wheel_odometry(drive, scale_error=0.0, yaw_drift=0.0, noise=0.0)
    relative = se3.inverse(drive.poses[0]) @ drive.poses
    assert np.allclose(odometry[:, 0], relative[:, 1, 3], atol=1e-9)
    assert np.allclose(odometry[:, 1], -relative[:, 0, 3], atol=1e-9)
    yaw = np.unwrap(np.arctan2(relative[:, 1, 0], relative[:, 0, 0]))
    assert np.allclose(odometry[:, 2], yaw, atol=1e-9)


def test_wheels_drift_by_the_stated_scale_and_angle() -> None:
    drive = round_the_table(110)
    odometry = wheel_odometry(drive, seed=5)
    assert np.array_equal(odometry, wheel_odometry(drive, seed=5))
    true = np.linalg.norm(np.diff(drive.poses[:, :3, 3], axis=0), axis=1).sum()
    assert np.linalg.norm(np.diff(odometry[:, :2], axis=0), axis=1).sum() / true == pytest.approx(
        1.04, abs=0.005
    )
    faultless = wheel_odometry(drive, scale_error=0.0, yaw_drift=0.0, noise=0.0)
    assert odometry[-1, 2] - faultless[-1, 2] == pytest.approx(0.01 * true, abs=0.03)


def test_the_room_is_the_same_every_time() -> None:
    one, two, other = furnished_room(1), furnished_room(1), furnished_room(2)
    assert len(one.surfaces) == len(two.surfaces) == len(other.surfaces)
    for a, b in zip(one.surfaces, two.surfaces):
        assert np.array_equal(a.picture, b.picture)
        assert np.array_equal(a.corner, b.corner)
    assert not all(np.array_equal(a.picture, b.picture) for a, b in zip(one.surfaces, other.surfaces))
    for surface in one.surfaces:
        assert abs(surface.right @ surface.down) < 1e-9
        ratio = np.array(surface.size) / surface.picture.shape[1::-1]
        if min(surface.picture.shape[:2]) > 20:
            assert ratio.max() / ratio.min() < 1.06  # texels are about square


def swaying(time: float) -> NDArray[np.float64]:
    """A pose that swings by some degrees and centimetres on its way."""
    turn = [0.07 * np.sin(4.0 * time), 0.05 * np.cos(3.0 * time), 0.5 * time, 0.0, 0.0, 0.0]
    T = se3.exp(turn)
    T[:3, 3] = [0.75 * time, 0.1 * np.sin(2.0 * time), 0.15 * np.sin(1.5 * time)]
    return T


def test_a_smooth_path_runs_through_its_poses_as_the_rig_did() -> None:
    times = np.arange(0.0, 4.0, 0.1)
    path = SmoothPath(Drive(times, np.array([swaying(t) for t in times])))
    assert all(np.allclose(path(t), swaying(t), atol=1e-9) for t in times)
    for time in np.arange(0.5, 3.5, 0.017):
        off = se3.log(se3.inverse(swaying(time)) @ path(time))
        assert np.abs(off[:3]).max() < 2e-5 and np.abs(off[3:]).max() < 2e-5
    for time in times[5:-5]:  # no kink at a pose: the same velocity just before and after
        before, after = (se3.log(se3.inverse(path(time - a)) @ path(time - a + 1e-4)) for a in (1e-4, 0.0))
        assert np.abs(after - before).max() < 1e-3 * np.abs(after).max()
    assert np.array_equal(path(-1.0), path(0.0)) and np.array_equal(path(9.0), path(times[-1]))


def test_a_smooth_path_does_not_swing_out_where_poses_are_missing() -> None:
    """A rig at half a metre a second, not seen for five seconds in which it turned by a right angle."""
    times = np.concatenate([np.arange(0.0, 1.0, 0.1), np.arange(6.0, 7.0, 0.1)])
    poses = np.array([se3.exp([0.0, 0.0, np.pi / 2 * (t > 3.0), 0.0, 0.0, 0.0]) for t in times])
    poses[:, 0, 3] = 0.5 * np.where(times < 3.0, times, times - 5.0)
    path = SmoothPath(Drive(times, poses))
    for time in np.arange(0.9, 6.0, 0.05):
        T = path(time)
        assert 0.4 < T[0, 3] < 0.55
        assert -0.02 < se3.log(T)[2] < np.pi / 2 + 0.02
