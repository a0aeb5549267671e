"""What wheels say of the way between keyframes, in a metre of their own."""

from __future__ import annotations

from itertools import chain

import numpy as np
from numpy.typing import NDArray

from facetcam.slam.adjustment.bundle import RelativePose
from facetcam.slam.map.map import Keyframe, shared_points
from facetcam.slam.odometry.planar import believable, planar_motion, usual_stretch

Array = NDArray[np.float64]

_METRE_SIGMA = 0.03  # by which a wheel's circumference is off
_TIES = 15  # points that two keyframes share, by which images place one against the other


class WheelSteps:
    """Odometry between keyframes that are neighbours in time, where it can be believed.

    Parameters
    ----------
    sigma : float
        Relative error of a step.

    Attributes
    ----------
    metre : float
        Metres that wheels count over one metre, as far as the images can tell. They share it in all steps:
        many steps that are all 4 % too long would else outweigh the images.
    """

    def __init__(self, sigma: float) -> None:
        self._sigma = sigma
        self.metre = 1.0

    def between(self, keyframes: list[Keyframe], first: int = 1) -> list[RelativePose]:
        """Steps that lead to the keyframes from `first` on."""
        motions, believed = [], self._believed(keyframes)
        for j in range(first, len(keyframes)):
            a, b = keyframes[j - 1].odometry, keyframes[j].odometry
            if believed[j - 1] and a is not None and b is not None:
                T_a_b, covariance = planar_motion(self._in_metres(a), self._in_metres(b), self._sigma)
                motions.append(RelativePose(j - 1, j, T_a_b, covariance))
        return motions

    def compare(self, keyframes: list[Keyframe], scale_sigma: float) -> None:
        """Tell the wheels' metre from a map whose scale the images know to `scale_sigma`, inf if not at all.

        It lies between two guesses, each by its weight: that wheels count right, and that the map does.
        """
        if len(keyframes) < 2:
            return
        odometry, poses = _ways(keyframes)
        stretch = usual_stretch(odometry, poses, self._believed(keyframes))
        share = _METRE_SIGMA**2 / (_METRE_SIGMA**2 + scale_sigma**2)
        self.metre = stretch**share

    def _in_metres(self, odometry: Array) -> Array:
        return odometry / [self.metre, self.metre, 1.0]

    def _believed(self, keyframes: list[Keyframe]) -> NDArray[np.bool_]:
        """Steps (K - 1,) between neighbours in time over which the wheels can be believed.

        What images hardly place they cannot deny: wheels that they bear out elsewhere are believed there.
        """
        neighbours = np.all(np.diff([(k.index, k.session) for k in keyframes], axis=0) == (1, 0), axis=1)
        believed = np.asarray(neighbours & believable(*_ways(keyframes), self._sigma))
        for i in np.flatnonzero(neighbours & ~believed).tolist() if believed.any() else ():
            believed[i] = not (_is_placed(i, keyframes) and _is_placed(i + 1, keyframes))
        return believed


def _is_placed(row: int, keyframes: list[Keyframe]) -> bool:
    """Tell whether images place a keyframe against any other one; mostly those just before it answer."""
    others = chain(reversed(keyframes[:row]), keyframes[row + 1 :])
    return any(shared_points(keyframes[row], k) >= _TIES for k in others)


def _ways(keyframes: list[Keyframe]) -> tuple[Array, Array]:
    """Odometry (K, 3), NaN where there is none, and poses (K, 4, 4)."""
    nothing = np.full(3, np.nan)
    odometry = np.array([nothing if k.odometry is None else k.odometry for k in keyframes])
    return odometry, np.array([k.T_world_rig for k in keyframes])
