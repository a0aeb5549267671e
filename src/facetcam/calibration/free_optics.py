"""Views with any pose, for what mirrors do not explain."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from facetcam.geometry import se3

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class FreeOptics:
    """Views with any pose: six parameters a view, from no drawing; for what mirrors do not explain."""

    T_image_rig: Array  # (V, 4, 4), of determinant -1 for mirror images

    @classmethod
    def of(cls, optics: Mapping[int, Array] | Sequence[Array]) -> FreeOptics:
        """Views at these signed poses T_image_rig."""
        return cls(np.array(optics))

    @property
    def count(self) -> int:
        return 6 * len(self.T_image_rig)

    @property
    def offsets(self) -> Array:
        return np.zeros(self.count)

    @property
    def tolerance(self) -> Array:
        return np.full(self.count, np.inf)

    def columns(self, view: int) -> Index:
        return np.arange(6 * view, 6 * view + 6)

    def into_camera(self, view: int, points: Array) -> Array:
        return se3.transform(self.T_image_rig[view], points)

    def derivatives(self, view: int, points: Array) -> tuple[Array, Array]:
        R = self.T_image_rig[view, :3, :3]
        seen = self.into_camera(view, points)
        by_values = np.concatenate([-se3.skew(seen), np.broadcast_to(np.eye(3), (len(points), 3, 3))], axis=2)
        return np.broadcast_to(R, (len(points), 3, 3)), by_values

    def moved(self, step: Array) -> FreeOptics:
        steps = step.reshape(-1, 6)
        return FreeOptics(np.array([se3.exp(s) @ T for s, T in zip(steps, self.T_image_rig)]))
