"""Flat mirrors: bounded polygons or unbounded planes."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from facetcam.errors import FacetcamError, RigError
from facetcam.geometry.reflection import plane_of_polygon, reflection

Array = NDArray[np.float64]

FLATNESS = 1e-5  # metres a vertex may stand off the plane of its polygon


@dataclass(frozen=True, eq=False)
class Mirror:
    """A flat mirror n.x = offset in the rig frame, both faces reflecting.

    Parameters
    ----------
    normal : (3,) array
        Unit normal.
    offset : float
        Metres along the normal.
    polygon : (N, 3) array or None
        Corners in order, in metres; None for an unbounded plane.
    """

    normal: Array
    offset: float
    polygon: Array | None = None
    _edges: Array | None = field(init=False, repr=False, default=None)

    def __post_init__(self) -> None:
        if self.polygon is not None:
            along = np.roll(self.polygon, -1, axis=0) - self.polygon
            object.__setattr__(self, "_edges", np.cross(self.normal, along))

    @classmethod
    def from_polygon(cls, name: str, vertices: ArrayLike) -> Mirror:
        """Make a mirror from polygon corners (N, 3), N >= 3, flat and convex.

        Raises
        ------
        RigError
            If the corners are not finite, not planar, not convex or span no area.
        """
        polygon = np.asarray(vertices, dtype=np.float64)
        if polygon.ndim != 2 or polygon.shape[1] != 3 or len(polygon) < 3:
            raise RigError(f"mirror '{name}': a polygon takes three or more corners [x, y, z]")
        if not np.all(np.isfinite(polygon)):
            raise RigError(f"mirror '{name}': polygon has a number that is not finite")
        try:
            normal, offset, flatness = plane_of_polygon(polygon)
        except FacetcamError as error:
            raise RigError(f"mirror '{name}': {error}; give corners that span a face") from None
        if flatness > FLATNESS:
            raise RigError(
                f"mirror '{name}': polygon is not flat, a corner stands {flatness * 1e3:.3f} mm off"
            )
        mirror = cls(normal, offset, polygon)
        if not np.all(mirror.contains(polygon, tolerance=1e-9)):
            raise RigError(
                f"mirror '{name}': polygon is not convex; give its corners in order round the edge"
            )
        return mirror

    @classmethod
    def from_plane(cls, name: str, normal: ArrayLike, offset: float) -> Mirror:
        """Make an unbounded mirror n.x = offset; the normal is brought to unit length with its offset.

        Raises
        ------
        RigError
            If a number is not finite or the normal is zero.
        """
        n = np.asarray(normal, dtype=np.float64)
        length = float(np.linalg.norm(n)) if n.shape == (3,) else 0.0
        if not (np.isfinite(length) and np.isfinite(offset)) or length < 1e-9:
            raise RigError(
                f"mirror '{name}': plane takes a normal [x, y, z] that is not zero and a finite offset"
            )
        return cls(n / length, float(offset) / length)

    @property
    def reflection(self) -> Array:
        """Reflection in the plane of the mirror, (4, 4)."""
        return reflection(self.normal, self.offset)

    def contains(self, points: Array, tolerance: float = 0.0) -> NDArray[np.bool_]:
        """Tell which points (N, 3) of the mirror's plane lie inside its edge."""
        if self.polygon is None or self._edges is None:
            return np.ones(len(points), dtype=bool)
        inside = np.ones(len(points), dtype=bool)
        for corner, inward in zip(self.polygon, self._edges):
            inside &= (points - corner) @ inward >= -tolerance * np.linalg.norm(inward)
        return inside

    def distance(self, origins: Array, directions: Array) -> Array:
        """Distance (N,) in metres along rays to the mirror; inf where they miss it or start on it."""
        slope = directions @ self.normal
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (self.offset - origins @ self.normal) / slope
        hit = np.isfinite(t) & (t > 1e-9)
        points = origins + np.where(hit, t, 0.0)[:, None] * directions
        return np.where(hit & self.contains(points), t, np.inf)
