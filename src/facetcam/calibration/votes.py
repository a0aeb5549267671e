"""The pose that most of several guesses speak for."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from facetcam.geometry import se3

Array = NDArray[np.float64]

_TURN = np.radians(30.0)  # by which poses through different views may disagree before the solve
_SHIFT = 0.4  # the same for their distance, as a share of it
_MOST = 200  # poses that are compared


class Votes:
    """Poses that sightings speak for, each with the distance it was seen over and a weight."""

    def __init__(self) -> None:
        self.poses: list[Array] = []
        self._distances: list[float] = []
        self._weights: list[float] = []

    def add(self, pose: Array, distance: float, weight: float) -> None:
        """Speak for a pose."""
        self.poses.append(pose)
        self._distances.append(distance)
        self._weights.append(weight)

    def winner(self) -> tuple[Array, float]:
        """The pose that most speak for, and their weight."""
        chosen = np.linspace(0, len(self.poses) - 1, min(len(self.poses), _MOST)).astype(np.int64)
        T, distance, weight = (np.array(x)[chosen] for x in (self.poses, self._distances, self._weights))
        near = np.array([agree(T, one, 0.5 * (distance + d)) for one, d in zip(T, distance)])
        support = near @ weight
        best = int(np.argmax(support))
        return mean(T[near[best]], weight[near[best]]), float(support[best])


def agree(T: Array, one: Array, scale: Array) -> NDArray[np.bool_]:
    """Mask (N,) of the poses (N, 4, 4) near `one`, their distances being of the size `scale` (N,)."""
    cosine = 0.5 * (np.einsum("nij,ij->n", T[:, :3, :3], one[:3, :3]) - 1.0)
    shift = np.linalg.norm(T[:, :3, 3] - one[:3, 3], axis=1)
    near: NDArray[np.bool_] = (cosine > np.cos(_TURN)) & (shift < _SHIFT * scale)
    return near


def turned_apart(a: Array, b: Array) -> float:
    """Grows with the angle between two poses."""
    return float(-np.einsum("ij,ij->", a[:3, :3], b[:3, :3]))


def mean(T: Array, weights: Array | None = None) -> Array:
    """The weighted mean of poses (N, 4, 4)."""
    R = Rotation.from_matrix(T[:, :3, :3]).mean(weights).as_matrix()
    return se3.from_rotation_translation(R, np.average(T[:, :3, 3], axis=0, weights=weights))


def distance_of(T: Array) -> float:
    """From the origin to that of a pose."""
    return float(np.linalg.norm(T[:3, 3]))
