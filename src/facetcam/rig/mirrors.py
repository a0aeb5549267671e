"""Flat mirrors: bounded polygons or unbounded planes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from facetcam.errors import FacetcamError, RigError
from facetcam.geometry.reflection import plane_of_polygon, reflection

Array = NDArray[np.float64]

FLATNESS = 1e-4  # metres a corner may stand off the plane, or inside the outline, of its polygon

SHORTEST = 1e-6  # metres between neighbouring corners, at least
THICKEST = 0.1  # metres of glass before a mirror
DENSEST = 4.0  # refractive index
_SHEET = 0.05  # of its thickness: panes of one kind differ by tenths of a millimetre
_WINDOW = 0.01  # by which window glass differs in its index


@dataclass(frozen=True)
class Glass:
    """The pane before the silver of an ordinary (second-surface) mirror.

    Parameters
    ----------
    thickness : float
        Metres, up to 0.1.
    index : float
        Refractive index; window glass has 1.52.
    thickness_sigma : float, optional
        How well the thickness is known, one standard deviation in metres: a calibration moves it within that
        and carries what remains; 0 holds it (default: 5 % of the thickness, as sheets are sold).
    index_sigma : float, optional
        The same of the index (default: 0.01).

    Raises
    ------
    RigError
        If a number is out of range.
    """

    thickness: float
    index: float = 1.52
    thickness_sigma: float | None = None
    index_sigma: float | None = None

    def __post_init__(self) -> None:
        if not 0.0 <= self.thickness <= THICKEST:
            raise RigError(f"glass: the thickness {self.thickness:g} must be 0 to {THICKEST:g} metres")
        if not 1.0 < self.index <= DENSEST:
            raise RigError(f"glass: the refractive index {self.index:g} must be above 1, up to {DENSEST:g}")
        for name in ("thickness_sigma", "index_sigma"):
            sigma = getattr(self, name)
            if sigma is not None and not 0.0 <= sigma < np.inf:
                raise RigError(f"glass: {name} must be 0 or more, got {sigma:g}")

    @property
    def sigmas(self) -> tuple[float, float]:
        """How well thickness and index are known, by what is stated or is usual."""
        usual = _SHEET * self.thickness, _WINDOW
        stated = self.thickness_sigma, self.index_sigma
        thickness, index = (u if s is None else s for s, u in zip(stated, usual))
        return thickness, index


@dataclass(frozen=True, eq=False)
class Mirror:
    """A flat mirror n.x = offset in the rig frame, both faces reflecting.

    With `glass` the plane is the face where light enters, from either side, and the reflecting silver lies
    the thickness of the glass behind it.

    Parameters
    ----------
    normal : (3,) array
        Unit normal.
    offset : float
        Metres along the normal.
    polygon : (N, 3) array or None
        Corners in order, in metres; None for an unbounded plane.
    glass : Glass or None
        None for a first-surface mirror.
    """

    normal: Array
    offset: float
    polygon: Array | None = None
    glass: Glass | None = None

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
        if np.linalg.norm(np.roll(polygon, -1, axis=0) - polygon, axis=1).min() < SHORTEST:
            raise RigError(f"mirror '{name}': two neighbouring corners of the polygon coincide; drop one")
        try:
            normal, offset, flatness = plane_of_polygon(polygon)
        except FacetcamError as error:
            raise RigError(f"mirror '{name}': {error}; give corners that span a face") from None
        if flatness > FLATNESS:
            raise RigError(
                f"mirror '{name}': polygon is not flat, a corner stands {flatness * 1e3:.3f} mm off"
            )
        mirror = cls(normal, offset, polygon)
        inside = polygon @ mirror.half_spaces[:, :3].T - mirror.half_spaces[:, 3]
        if inside.min() < -FLATNESS:
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
        if abs(length - 1.0) < 1e-12:  # a normal that was saved comes back bit by bit
            return cls(n, float(offset))
        return cls(n / length, float(offset) / length)

    @property
    def reflection(self) -> Array:
        """Reflection in the plane of the mirror, (4, 4)."""
        return reflection(self.normal, self.offset)

    @cached_property
    def half_spaces(self) -> Array:
        """One row (a, b, c, d) an edge: inside it a x + b y + c z >= d; no row for an unbounded mirror."""
        if self.polygon is None:
            return np.empty((0, 4))
        inward = np.cross(self.normal, np.roll(self.polygon, -1, axis=0) - self.polygon)
        inward /= np.linalg.norm(inward, axis=1, keepdims=True)
        return np.column_stack([inward, np.einsum("ij,ij->i", inward, self.polygon)])
