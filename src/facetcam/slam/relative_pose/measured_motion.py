"""A motion that wheels have measured, as a witness beside the corners of two frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from facetcam.slam.relative_pose.pairs import EPIPOLAR_GATE

Array = NDArray[np.float64]

EPIPOLAR_SIGMA = 0.5  # px
MEASURED_SHARE = 0.1  # of the pairs, for which it counts: what bends one pair bends others alike
_ASIDE_SIGMA = 0.1  # radians: wheels slip to the side, floors rise


@dataclass(frozen=True, slots=True)
class Measured:
    """A motion that wheels have measured, and how sure its turn is: standard deviations (3,) in radians."""

    T_a_b: Array
    turn_sigmas: Array

    def off(self, T_a_b: Array) -> Array:
        """By how much motions turn otherwise and go aside (..., 6), in standard deviations."""
        turns = Rotation.from_matrix(self.T_a_b[:3, :3].T @ T_a_b[..., :3, :3]).as_rotvec()
        aside = _direction(T_a_b) - _direction(self.T_a_b)
        return np.concatenate([turns / self.turn_sigmas, aside / _ASIDE_SIGMA], axis=-1)

    def misfit(self, T_a_b: Array) -> Array:
        """Its part in a mean of distances in pixels, cut off alike."""
        off = np.minimum(EPIPOLAR_SIGMA * np.linalg.norm(self.off(T_a_b), axis=-1), EPIPOLAR_GATE)
        return np.asarray(MEASURED_SHARE * off)


def _direction(T_a_b: Array) -> Array:
    """Unit vectors (..., 3) of the ways of motions."""
    way = T_a_b[..., :3, 3]
    return np.asarray(way / np.maximum(np.linalg.norm(way, axis=-1, keepdims=True), 1e-9))
