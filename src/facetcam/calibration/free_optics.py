"""Views with any pose, for what mirrors do not explain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from facetcam.calibration.optics import MirrorOptics, follow_through
from facetcam.geometry import se3
from facetcam.geometry.glass import straightened

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class FreeOptics:
    """Views with any pose: six parameters a view, from no drawing; for what mirrors do not explain.

    Attributes
    ----------
    T_image_rig : (V, 4, 4) array
        Of determinant -1 for mirror images.
    panes : tuple of (normals, glass) or None
        Of each view the glass that it is seen through, which stays as it is.
    """

    T_image_rig: Array
    panes: tuple[tuple[Array, Array] | None, ...]

    @classmethod
    def of(
        cls, poses: Sequence[Array], panes: Sequence[tuple[Array, Array] | None] | None = None
    ) -> FreeOptics:
        """Views at these signed poses T_image_rig."""
        return cls(np.array(poses), tuple(panes or [None] * len(poses)))

    @classmethod
    def of_mirrors(cls, optics: MirrorOptics) -> FreeOptics:
        """Views where mirrors have them, and seen through the same glass."""
        views = range(len(optics.chains))
        return cls.of([optics.T_image_rig(v) for v in views], [optics.panes(v) for v in views])

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
        seen, panes = se3.transform(self.T_image_rig[view], points), self.panes[view]
        return seen if panes is None else straightened(seen, *panes)[0]

    def derivatives(self, view: int, points: Array) -> tuple[Array, Array]:
        before, panes = se3.transform(self.T_image_rig[view], points), self.panes[view]
        by_points = np.broadcast_to(self.T_image_rig[view, :3, :3], (len(points), 3, 3))
        by_pose = np.concatenate([-se3.skew(before), np.broadcast_to(np.eye(3), (len(points), 3, 3))], axis=2)
        if panes is None:
            return by_points, by_pose
        through = follow_through(straightened(before, *panes)[0], panes)
        return through @ by_points, through @ by_pose

    def moved(self, step: Array) -> FreeOptics:
        steps = step.reshape(-1, 6)
        return replace(self, T_image_rig=np.array([se3.exp(s) @ T for s, T in zip(steps, self.T_image_rig)]))
