"""Points from rays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def triangulate_two_rays(
    origins_a: Array, directions_a: Array, origins_b: Array, directions_b: Array
) -> tuple[Array, Array, Array, Array]:
    """Midpoint of the shortest segment between pairs of rays.

    Parameters
    ----------
    origins_a, directions_a, origins_b, directions_b : (N, 3) arrays
        Ray origins in metres and unit directions, in one frame.

    Returns
    -------
    points : (N, 3) array
        Midpoints in metres; meaningless where `angle` is zero.
    distance_a, distance_b : (N,) arrays
        Signed distances along each ray, in metres; negative is behind the origin, inf for parallel rays.
    angle : (N,) array
        Angle between the rays, in radians.
    """
    cosine = np.einsum("ij,ij->i", directions_a, directions_b)
    normal = np.cross(directions_a, directions_b)
    sine2 = np.einsum("ij,ij->i", normal, normal)
    between = origins_b - origins_a
    along_a = np.einsum("ij,ij->i", between, directions_a)
    along_b = np.einsum("ij,ij->i", between, directions_b)
    with np.errstate(divide="ignore", invalid="ignore"):
        distance_a = np.where(sine2 > 0, (along_a - cosine * along_b) / sine2, np.inf)
        distance_b = np.where(sine2 > 0, (cosine * along_a - along_b) / sine2, np.inf)
    finite_a = np.where(np.isfinite(distance_a), distance_a, 0.0)[:, None]
    finite_b = np.where(np.isfinite(distance_b), distance_b, 0.0)[:, None]
    points = 0.5 * (origins_a + finite_a * directions_a + origins_b + finite_b * directions_b)
    return points, distance_a, distance_b, np.arctan2(np.sqrt(sine2), cosine)
