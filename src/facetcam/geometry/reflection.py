"""Planes and reflections: with the camera model, the only place where a determinant of -1 may live."""

from __future__ import annotations

from functools import reduce

import numpy as np
from numpy.typing import ArrayLike, NDArray

from facetcam.errors import FacetcamError

Array = NDArray[np.float64]

FLIP_X = np.diag([-1.0, 1.0, 1.0, 1.0])


def reflection(normal: ArrayLike, offset: float) -> Array:
    """Reflection in the plane n.x = offset, as a 4x4 matrix S with S S = I.

    Parameters
    ----------
    normal : (3,) array
        Unit normal.
    offset : float
        Distance of the plane from the origin along the normal, in metres.
    """
    n = np.asarray(normal, dtype=np.float64)
    S = np.eye(4)
    S[:3, :3] -= 2.0 * np.outer(n, n)
    S[:3, 3] = 2.0 * offset * n
    return S


def chain(reflections: list[Array]) -> Array:
    """S_k ... S_1 of reflections given in the order in which a camera ray meets them."""
    return reduce(lambda product, S: S @ product, reflections, np.eye(4))


def plane_of_polygon(vertices: ArrayLike) -> tuple[Array, float, float]:
    """Least-squares plane of polygon vertices.

    Parameters
    ----------
    vertices : (N, 3) array
        N >= 3 corners in order round the polygon, in metres.

    Returns
    -------
    normal : (3,) array
        Unit normal, right-handed to the order of the vertices.
    offset : float
        n.x = offset on the plane.
    flatness : float
        Largest distance of a vertex from the plane, in metres.

    Raises
    ------
    FacetcamError
        If the vertices span no area.
    """
    v = np.asarray(vertices, dtype=np.float64)
    centre = v.mean(axis=0)
    area_vector = 0.5 * np.cross(v - centre, np.roll(v, -1, axis=0) - centre).sum(axis=0)
    extent = float(np.linalg.norm(v - centre, axis=1).max())
    if np.linalg.norm(area_vector) < 1e-6 * extent**2 or extent == 0.0:
        raise FacetcamError("the polygon has no area")
    normal = np.linalg.svd(v - centre)[2][2]
    normal = normal * (1.0 if normal @ area_vector >= 0 else -1.0)
    offset = float(normal @ centre)
    return normal, offset, float(np.abs(v @ normal - offset).max())
