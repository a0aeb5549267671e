"""Wheel odometry: planar poses in a drifting frame of their own, and what they say of the rig's motion."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from facetcam.errors import FacetcamError
from facetcam.geometry import se3

Array = NDArray[np.float64]

# The robot's x axis is the rig's front, +y.
_T_base_rig = se3.from_rotation_translation([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], np.zeros(3))

_FLOOR_METRES = 0.005
_FLOOR_RADIANS = 0.01
_UNLEVEL_RADIANS = 0.1  # a ramp or a bump between two keyframes
_STANDING = 0.03  # metres; shorter ways say nothing about slip
_JITTER = 0.015  # metres by which they may differ in any case
_SLIP = 0.5  # share of a way by which wheels and images may differ
_TURN_SIGMAS = 4.0
_TURNING = 0.05  # radians between two frames
_BORNE_OUT = 0.5  # share of the steps that must agree, else none is believed
_FEW_STEPS = 5
_MOST_OFF = 10.0  # factor between the wheels' metre and the map's


def checked_odometry(odometry: ArrayLike | None) -> Array | None:
    """Odometry as three finite numbers; raises FacetcamError if it is anything else."""
    if odometry is None:
        return None
    wheels = np.asarray(odometry, dtype=np.float64)
    if wheels.shape != (3,) or not np.all(np.isfinite(wheels)):
        raise FacetcamError(f"odometry: expected finite x, y, yaw, got {np.array2string(wheels)}")
    return wheels


def planar_pose(odometry: Array) -> Array:
    """Rig pose (4, 4) in the odometry frame of (x, y, yaw)."""
    x, y, yaw = odometry.tolist()
    c, s = math.cos(yaw), math.sin(yaw)
    turn = [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]
    return se3.from_rotation_translation(turn, [x, y, 0.0]) @ _T_base_rig


def planar_motion(a: Array, b: Array, sigma: float) -> tuple[Array, Array]:
    """Rig motion from odometry (x, y, yaw) at two times.

    Parameters
    ----------
    a, b : (3,) arrays
        Metres and radians.
    sigma : float
        Relative error of distance and turn.

    Returns
    -------
    T_a_b : (4, 4) array
    covariance : (6, 6) array
        Rotation then translation. Height, roll and pitch are left loose: floors are not flat.
    """
    T_a_b = se3.inverse(planar_pose(a)) @ planar_pose(b)
    distance = float(np.linalg.norm(T_a_b[:2, 3]))
    turn = abs(float(np.arctan2(T_a_b[1, 0], T_a_b[0, 0])))
    yaw_sigma = sigma * turn / 3.0 + _FLOOR_RADIANS
    translation_sigma = sigma * distance + _FLOOR_METRES
    sigmas = np.array([_UNLEVEL_RADIANS, _UNLEVEL_RADIANS, yaw_sigma, *(3 * [translation_sigma])])
    return T_a_b, np.diag(sigmas**2)


def believable(odometry: Array, T_world_rig: Array, sigma: float) -> NDArray[np.bool_]:
    """Tell which steps of the wheels the images bear out.

    Wheels slip, are blocked or lifted, and their tables jump. A step is believed where it turns as the images
    say, and is as long as they say but for a factor that all steps share: neither the wheels' metre nor the
    map's is proven. Where most steps are denied, the few that agree do so by chance, and none is believed.

    Parameters
    ----------
    odometry : (K, 3) array
        x, y, yaw at successive frames; NaN where there is none.
    T_world_rig : (K, 4, 4) array
        Poses of the frames from the images.
    sigma : float
        Relative error of distance and turn.

    Returns
    -------
    (K - 1,) bool array
    """
    T_seen = se3.inverse(T_world_rig[:-1]) @ T_world_rig[1:]
    turn = np.arctan2(np.sin(np.diff(odometry[:, 2])), np.cos(np.diff(odometry[:, 2])))
    seen_turn = np.arctan2(T_seen[:, 1, 0], T_seen[:, 0, 0])
    turns = np.abs(turn - seen_turn) < _TURN_SIGMAS * (sigma * np.abs(seen_turn) / 3.0 + _FLOOR_RADIANS)
    way, seen_way = _ways(odometry), T_seen[:, :2, 3]
    length, seen_length = np.linalg.norm(way, axis=1), np.linalg.norm(seen_way, axis=1)
    rolling = turns & (np.minimum(length, seen_length) > _STANDING)
    usual = float(np.median(length[rolling] / seen_length[rolling])) if rolling.any() else 1.0
    difference = np.linalg.norm(way - usual * seen_way, axis=1)
    longest = np.maximum(length, usual * seen_length)
    agrees = turns & (difference < _SLIP * longest + _JITTER)
    telling = (longest > _STANDING) | (np.maximum(np.abs(turn), np.abs(seen_turn)) > _TURNING)
    borne_out = not telling.any() or float(agrees[telling].mean()) >= _BORNE_OUT
    one_metre = 1.0 / _MOST_OFF < usual < _MOST_OFF
    return np.asarray(agrees & (borne_out and one_metre))


def usual_stretch(odometry: Array, T_world_rig: Array, believed: NDArray[np.bool_]) -> float:
    """Median length of the believed steps over that which the images have measured; 1 for a few steps.

    `odometry` and `T_world_rig` are those of `believable`, whose answer `believed` is.
    """
    length = np.linalg.norm(_ways(odometry), axis=1)
    seen_length = np.linalg.norm((se3.inverse(T_world_rig[:-1]) @ T_world_rig[1:])[:, :2, 3], axis=1)
    telling = believed & (np.minimum(length, seen_length) > _STANDING)
    return float(np.median(length[telling] / seen_length[telling])) if telling.sum() >= _FEW_STEPS else 1.0


def _ways(odometry: Array) -> Array:
    """Steps (K - 1, 2) of the wheels, x and y in the rig frame where each one starts."""
    step, yaw = np.diff(odometry[:, :2], axis=0), odometry[:-1, 2]
    ahead = step[:, 0] * np.cos(yaw) + step[:, 1] * np.sin(yaw)
    to_the_left = step[:, 1] * np.cos(yaw) - step[:, 0] * np.sin(yaw)
    return np.column_stack([-to_the_left, ahead])
