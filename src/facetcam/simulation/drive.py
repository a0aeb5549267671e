"""A robot's drive round the room, and what its wheels report of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, RotationSpline, Slerp

from facetcam.errors import FacetcamError
from facetcam.geometry import se3

Array = NDArray[np.float64]

SPEED = 0.75  # metres a second, reached within the first second
MOST_FRAMES = 1_000_000  # a day at 11 frames a second
_GAP = 4.0  # times the usual step between poses
WHEELBASE = 0.3  # metres over which bumps tilt the robot
BUMPS = ((1.2, 0.15), (3.4, 0.4), (5.6, 0.2))  # metres along the path, half width in metres


@dataclass(frozen=True, eq=False, slots=True)
class Drive:
    """True motion of the rig.

    Attributes
    ----------
    times : (N,) array
        Seconds.
    poses : (N, 4, 4) array
        T_world_rig.
    """

    times: Array
    poses: Array

    def __len__(self) -> int:
        return len(self.times)


class SmoothPath:
    """The motion through the poses of a drive, with a steady velocity; at rest before and after them.

    A rolling shutter shows how the rig moves within a frame, and no rig changes its velocity at once. Where
    poses are missing it goes straight on to the next one.

    Parameters
    ----------
    drive : Drive
    """

    def __init__(self, drive: Drive) -> None:
        from scipy.interpolate import CubicSpline

        self._drive = drive
        if len(drive) > 1:
            times, turns, places = _with_ends_of_gaps(drive)
            self._turn = RotationSpline(times, turns)
            self._place = CubicSpline(times, places, bc_type="natural")

    def __call__(self, time: float) -> Array:
        """T_world_rig (4, 4) at a time in seconds."""
        times = self._drive.times
        if len(times) == 1:
            return np.asarray(self._drive.poses[0])
        moment = float(np.clip(time, times[0], times[-1]))
        return se3.from_rotation_translation(self._turn(moment).as_matrix(), self._place(moment))


def _with_ends_of_gaps(drive: Drive) -> tuple[Array, Rotation, Array]:
    """Times, turns and places (N, 3), two more in each gap: without them splines swing out there."""
    times, turns = drive.times, Rotation.from_matrix(drive.poses[:, :3, :3])
    places, steps = drive.poses[:, :3, 3], np.diff(drive.times)
    gaps = np.flatnonzero(steps > _GAP * np.median(steps))
    more = np.concatenate([times[gaps] + np.median(steps), times[gaps + 1] - np.median(steps)])
    order = np.argsort(np.concatenate([times, more]))
    between = np.column_stack([np.interp(more, times, column) for column in places.T])
    return (
        np.concatenate([times, more])[order],
        Rotation.concatenate([turns, Slerp(times, turns)(more)])[order],
        np.concatenate([places, between])[order],
    )


def round_the_table(frames: int, fps: float = 10.0, height: float = 0.85, bumps: float = 0.0) -> Drive:
    """Drive a wavy loop round the middle of the built-in room, facing along the path.

    Parameters
    ----------
    frames : int
        The loop closes after about 100 frames at 10 a second.
    fps : float
    height : float
        Metres of the rig above the floor.
    bumps : float
        Height in metres of the bumps and ramps on the way; 0 for a plane drive.
    """
    times = np.arange(frames) / fps
    travelled = SPEED * (times + np.exp(-3.0 * times) / 3.0 - 1.0 / 3.0)
    angle = np.linspace(-0.6, -0.6 + 6 * np.pi, 12001)
    radius = 1.0 + 0.08 * np.sin(3.0 * angle) + 0.05 * np.sin(2.0 * angle + 1.0)
    path = radius[:, None] * np.column_stack([1.25 * np.cos(angle), 0.95 * np.sin(angle)])
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    heading = np.unwrap(np.arctan2(np.gradient(path[:, 1]), np.gradient(path[:, 0])))
    x, y, yaw = (np.interp(travelled, length, values) for values in (path[:, 0], path[:, 1], heading))
    front = bumps * _ground(travelled + WHEELBASE / 2)
    rear = bumps * _ground(travelled - WHEELBASE / 2)
    z, pitch = height + (front + rear) / 2, np.arctan2(front - rear, WHEELBASE)
    poses = np.array([_pose(*values) for values in zip(x, y, z, yaw, pitch)])
    return Drive(times, poses)


def through(waypoints: Array, fps: float, speed: float = SPEED, height: float = 0.9) -> Drive:
    """Drive along a smooth curve through points on the floor, facing along it.

    Parameters
    ----------
    waypoints : (N, 2) array
        x, y in metres; two or more. The curve is closed where the last one is the first.
    fps, speed, height : float
        Frames and metres a second, and metres of the rig above z = 0.

    Raises
    ------
    FacetcamError
        If there are too few points or too many frames, neighbouring points coincide, or a number is not above
        zero and finite.
    """
    points = np.asarray(waypoints, dtype=np.float64).reshape(-1, 2)
    apart = np.linalg.norm(np.diff(points, axis=0), axis=1)
    if len(points) < 2 or not np.isfinite(points).all():
        raise FacetcamError(f"waypoints: give two or more finite points, got {len(points)}")
    if apart.min() < 1e-6:
        k = int(np.argmin(apart)) + 1
        raise FacetcamError(f"waypoints: points {k} and {k + 1} are one place; leave one of them out")
    if not (0 < fps < np.inf and 0 < speed < np.inf):
        raise FacetcamError(f"drive: fps {fps:g} and speed {speed:g} must be above zero and finite")
    if not (np.isfinite(height) and apart.sum() / speed * fps < MOST_FRAMES):
        raise FacetcamError(
            f"drive: {apart.sum():g} m at {speed:g} m/s and {fps:g} frames/s, {height:g} m high, is none; "
            f"below {MOST_FRAMES} frames and a finite height make one"
        )
    if apart.sum() / speed * fps < 1.0:
        raise FacetcamError(
            f"drive: {apart.sum():g} m at {speed:g} m/s end before the second of {fps:g} frames/s; go slower"
        )
    from scipy.interpolate import CubicSpline

    closed = len(points) > 3 and bool(np.array_equal(points[0], points[-1]))
    along = np.concatenate([[0.0], np.cumsum(apart)])
    curve = CubicSpline(along, points, bc_type="periodic" if closed else "natural")
    fine = np.linspace(0.0, along[-1], 200 * len(points))
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve(fine), axis=0), axis=1))])
    times = np.arange(max(2, int(length[-1] / speed * fps) + 1)) / fps
    place = np.interp(speed * times, length, fine)
    x, y = curve(place).T
    yaw = np.arctan2(*curve(place, 1).T[::-1])
    return Drive(times, np.array([_pose(*values, 0.0) for values in zip(x, y, np.full(len(x), height), yaw)]))


def wheel_odometry(
    drive: Drive, seed: int = 0, scale_error: float = 0.04, yaw_drift: float = 0.01, noise: float = 0.01
) -> Array:
    """What wheels report: a path in a frame of its own that drifts away.

    Parameters
    ----------
    drive : Drive
    seed : int
    scale_error : float
        Relative error of every length.
    yaw_drift : float
        Radians a metre.
    noise : float
        Standard deviation of scale (relative) and turn (radians a metre) from step to step.

    Returns
    -------
    (N, 3) array
        x along the rig's front (+y), y to its left in metres, and yaw in radians, from (0, 0, 0).
    """
    rng = np.random.default_rng(seed)
    x = y = yaw = 0.0
    rows = [(x, y, yaw)]
    for before, after in zip(drive.poses, drive.poses[1:]):
        step = se3.inverse(before) @ after
        forward, left = np.array([step[1, 3], -step[0, 3]]) * (
            1.0 + scale_error + noise * rng.standard_normal()
        )
        x += forward * np.cos(yaw) - left * np.sin(yaw)
        y += forward * np.sin(yaw) + left * np.cos(yaw)
        yaw += np.arctan2(step[1, 0], step[0, 0]) + (yaw_drift + noise * rng.standard_normal()) * abs(forward)
        rows.append((x, y, yaw))
    return np.array(rows)


def _ground(travelled: Array) -> Array:
    """Height of the ground along the path, 1 on top of a bump."""
    return np.asarray(sum(np.exp(-(((travelled - place) / width) ** 2)) for place, width in BUMPS))


def _pose(x: float, y: float, z: float, yaw: float, pitch: float) -> Array:
    """T_world_rig: the rig's +y looks along the yaw, its nose lifted by the pitch."""
    T = se3.exp([0.0, 0.0, yaw - np.pi / 2, 0.0, 0.0, 0.0]) @ se3.exp([pitch, 0.0, 0.0, 0.0, 0.0, 0.0])
    T[:3, 3] = (x, y, z)
    return T
