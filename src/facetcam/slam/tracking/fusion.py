"""A pose from sight and a step of the wheels, each by how sure it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from facetcam.geometry import se3
from facetcam.slam.camera.pose import Pose
from facetcam.slam.tracking.uncertainty import TOGETHER

Array = NDArray[np.float64]

_CONTRADICTS = 22.5  # squared standard deviations of six numbers, beyond which wheels have slipped (.1 %)


def fused(pose: Pose, T_told: Array, covariance: Array) -> Pose:
    """A pose by sight, moved towards what was told otherwise where sight itself cannot tell.

    A wall that one view shows moves alike whether the rig goes along it or turns: there the wheels decide.
    What contradicts sight is left out.

    Parameters
    ----------
    pose : Pose
    T_told : (4, 4) array
        Pose by dead reckoning.
    covariance : (6, 6) array
        Of it, as a right-hand twist.
    """
    if contradict(pose, T_told, covariance):
        return pose
    seen = TOGETHER * pose.covariance
    gain = np.linalg.solve(seen + covariance, seen).T
    T = pose.T_world_rig @ se3.exp(gain @ _off(pose, T_told))
    return replace(pose, T_world_rig=T, covariance=(np.eye(6) - gain) @ pose.covariance)


def contradict(pose: Pose, T_told: Array, covariance: Array) -> bool:
    """Tell whether sight and wheels cannot both be right."""
    off = _off(pose, T_told)
    return bool(off @ np.linalg.solve(TOGETHER * pose.covariance + covariance, off) > _CONTRADICTS)


def _off(pose: Pose, T_told: Array) -> Array:
    return se3.log(se3.inverse(pose.T_world_rig) @ T_told)
