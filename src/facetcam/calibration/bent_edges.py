"""A lens bends the edges of squares; corners fitted with straight ones are drawn to the hollow side.

An edge of curvature k, fitted over R pixels to both sides, lies k R^2 / 6 off where it crosses the other.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_BESIDE = 0.1  # squares between the points by which a curvature is told


def drawn_aside(project: Callable[[Array], Array], points: Array, square: float, radius: Array) -> Array:
    """How far fitted corners lie from where they are, (N, 2) pixels.

    Parameters
    ----------
    project : callable
        From points (N, 3) of the board's frame to pixels (N, 2).
    points : (N, 3) array
        The corners; the edges run along x and y.
    square : float
        Side of a square, metres.
    radius : (N,) array
        Of the circle in which the edges are fitted, pixels.
    """
    corner = project(points)
    normals, offsets = np.empty((len(points), 2, 2)), np.empty((len(points), 2, 1))
    for edge, way in enumerate(np.eye(3)[:2] * _BESIDE * square):
        before, after = project(points - way), project(points + way)
        along = 0.5 * (after - before)
        length = np.maximum(np.linalg.norm(along, axis=1), 1e-9)
        normals[:, edge] = np.stack([-along[:, 1], along[:, 0]], axis=1) / length[:, None]
        curvature = np.sum((after + before - 2.0 * corner) * normals[:, edge], axis=1) / length**2
        offsets[:, edge, 0] = curvature * radius**2 / 6.0
    across = np.abs(np.linalg.det(normals)) > 0.1  # edges seen nearly end on cross nowhere in particular
    normals[~across] = np.eye(2)
    return np.where(across[:, None], np.linalg.solve(normals, offsets)[..., 0], 0.0)
