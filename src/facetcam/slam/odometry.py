"""Wheel odometry: planar poses in a drifting frame of their own, and what they say of the rig's motion."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from facetcam.geometry import se3

Array = NDArray[np.float64]

# The robot's x axis is the rig's front, +y.
_T_base_rig = se3.from_rotation_translation([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], np.zeros(3))

_FLOOR_METRES = 0.005
_FLOOR_RADIANS = 0.01
_UNLEVEL_RADIANS = 0.1  # a ramp or a bump between two keyframes


def planar_pose(odometry: Array) -> Array:
    """Rig pose (4, 4) in the odometry frame of (x, y, yaw)."""
    x, y, yaw = odometry
    return se3.from_rotation_translation(se3.exp([0, 0, yaw, 0, 0, 0])[:3, :3], [x, y, 0.0]) @ _T_base_rig


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
