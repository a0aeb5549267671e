"""A mirror's plane as the solver moves it: against the drawing, with derivatives of its reflection."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from facetcam.geometry import reflection, se3
from facetcam.rig import Mirror

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Plane:
    """A mirror's plane: tilts a, b about a point of the drawing, and a shift along the normal."""

    normal: Array  # of the drawing
    axes: Array  # (2, 3), across the normal
    pivot: Array
    values: Array  # (tan of tilt towards axes[0], towards axes[1], shift in metres)

    @classmethod
    def of(cls, mirror: Mirror, towards: Array) -> Plane:
        """The plane of a mirror; it tilts about its middle, unbounded about its foot under `towards`."""
        n = mirror.normal
        if mirror.polygon is None:
            pivot = towards - (n @ towards - mirror.offset) * n
        else:
            pivot = mirror.polygon.mean(axis=0)
        across = np.linalg.svd(n[None])[2][1:]
        return cls(n, across, pivot, np.zeros(3))

    @cached_property
    def _slope(self) -> tuple[Array, float]:
        sloped = self.normal + self.values[:2] @ self.axes
        length = float(np.linalg.norm(sloped))
        return sloped / length, length

    @property
    def plane(self) -> tuple[Array, float]:
        """Normal and offset."""
        n = self._slope[0]
        return n, float(n @ self.pivot + self.values[2])

    @cached_property
    def reflection(self) -> Array:
        """Reflection, (4, 4)."""
        return reflection.reflection(*self.plane)

    @cached_property
    def derivatives(self) -> Array:
        """Derivatives of the reflection by the three values, (3, 4, 4)."""
        n, d = self.plane
        by_normal = (self.axes - (self.axes @ n)[:, None] * n) / self._slope[1]
        out = np.zeros((3, 4, 4))
        for i, dn in enumerate([*by_normal, np.zeros(3)]):
            dd = 1.0 if i == 2 else dn @ self.pivot
            out[i, :3, :3] = -2.0 * (np.outer(dn, n) + np.outer(n, dn))
            out[i, :3, 3] = 2.0 * (dd * n + d * dn)
        return out

    def motion(self) -> Array:
        """Rigid motion (4, 4) from the mirror as drawn to as it is, without sliding in its plane."""
        n = self._slope[0]
        axis = np.cross(self.normal, n)
        sine = float(np.linalg.norm(axis))
        angle = np.arctan2(sine, float(self.normal @ n))
        R = se3.exp(np.r_[axis * (angle / sine if sine > 1e-15 else 1.0), 0.0, 0.0, 0.0])[:3, :3]
        return se3.from_rotation_translation(R, self.pivot - R @ self.pivot + self.values[2] * n)

    def moved(self, mirror: Mirror) -> Mirror:
        """The mirror at this plane; a polygon moves with it."""
        normal, offset = self.plane
        polygon = None if mirror.polygon is None else se3.transform(self.motion(), mirror.polygon)
        return replace(mirror, normal=normal, offset=offset, polygon=polygon)
