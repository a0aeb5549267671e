"""What is unknown of a live pose: its measurement, the map round it, and the scale of the way since."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from facetcam.geometry import se3
from facetcam.slam.map.map import Keyframe

Array = NDArray[np.float64]

TOGETHER = 6.0  # errors of points that share a keyframe, a lens and a rig go together; variances grow by this
_ASIDE = 0.1  # a way of unsure length is unsure to the sides too, by this share
_BENT = 0.0015  # radians for each unit of that share: views of a wrong scale stand where they do not
_WHEELS = 0.3  # relative error of a way that only wheels have measured
_UNKNOWN = 2.0  # and where nothing has: sight begins one world in ten three times too small or large


def pose_covariance(
    T_world_rig: Array, measured: Array, keyframes: list[Keyframe], scale_sigma: float, wheels: bool
) -> Array:
    """Covariance (6, 6) of a live pose against the first keyframe, as a right-hand twist.

    Parameters
    ----------
    T_world_rig : (4, 4) array
    measured : (6, 6) array
        Covariance of the pose in the map as it is.
    keyframes : list of Keyframe
        Near the pose, the likeliest base first; the first one that was judged is taken, else the last,
        which is the first of the map: an unknown scale counts from there. What the map may have drifted since
        it was judged is that of the first in the list.
    scale_sigma : float
        Relative standard deviation of the scale; where it is not known yet, that of the wheels counts.
    wheels : bool
        True where odometry has set the scale.
    """
    base = next((k for k in keyframes if k.covariance is not None), keyframes[-1])
    total = TOGETHER * measured
    if base.covariance is not None:
        total += TOGETHER * _carried(base.covariance, base, T_world_rig)
    if keyframes[0].covariance is None:
        total += TOGETHER * _carried(keyframes[0].drift, keyframes[0], T_world_rig)
    # Where the scale is unknown, the covariances of keyframes leave it out.
    since = base if np.isfinite(scale_sigma) else keyframes[-1]
    way = (se3.inverse(T_world_rig) @ since.T_world_rig)[:3, 3]
    unsure = min(scale_sigma, _WHEELS if wheels else _UNKNOWN)
    stretch = unsure * way
    total[:3, :3] += (_BENT * unsure) ** 2 * np.eye(3)
    total[3:, 3:] += np.outer(stretch, stretch) + _ASIDE**2 * (stretch @ stretch) * np.eye(3)
    return total


def drift_of(keyframe: Keyframe, measured: Array, before: Keyframe) -> Array:
    """Covariance (6, 6) of a new keyframe against those that were judged: what poses lack adds up on the way.

    `measured` is the covariance of its pose in the map, `before` the last keyframe before it.
    """
    return measured + _carried(before.drift, before, keyframe.T_world_rig)


def _carried(covariance: Array, keyframe: Keyframe, T_world_rig: Array) -> Array:
    """What a covariance (6, 6) at a keyframe does to a pose that hangs on it."""
    moved = se3.adjoint(se3.inverse(T_world_rig) @ keyframe.T_world_rig)
    return np.asarray(moved @ covariance @ moved.T)


def reckoned_covariance(before: Array, T_step: Array, step: Array) -> Array:
    """Covariance (6, 6) after a step by the wheels alone, whose own covariance is given."""
    moved = se3.adjoint(se3.inverse(T_step))
    return np.asarray(moved @ before @ moved.T + step)
