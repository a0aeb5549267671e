"""Rays through ordinary mirrors: refraction at the front of the glass, reflection at its back.

A slab of glass before a mirror leaves the direction of the reflected ray alone and shifts the ray along
the front face by 2 t d_t / sqrt(n^2 - |d_t|^2), with d_t the part of its unit direction d along the face
(Snell's law, twice). The same ray results when it starts off the camera's centre, along the normal of the
face, and meets a thin mirror in the front face: this is the *displacement* used here. It depends on the
direction, so a view through glass has no exact centre.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_STEPS = 60  # of the iteration; five or so are enough for points further off than a few thicknesses
_SOLVED = 1e-14  # change of a unit direction


def slant(cosine: Array, thickness: float, index: float) -> Array:
    """Way 2 t / sqrt(n^2 - sin^2) that a mirror behind glass adds, in metres, per unit of direction.

    Parameters
    ----------
    cosine : array
        Of the angle between ray and normal; the sign does not matter.
    thickness : float
        Metres of glass.
    index : float
        Refractive index, above 1.
    """
    way: Array = 2.0 * thickness / np.sqrt(index * index - 1.0 + cosine * cosine)
    return way


def displacement(directions: Array, normals: Array, glass: Array) -> Array:
    """Where rays seem to start, off the camera's centre, when mirrors of a chain lie behind glass.

    Parameters
    ----------
    directions : (N, 3) array
        Unit directions in the camera frame.
    normals : (M, 3) array
        Unit normals of the chain's mirrors in the camera frame, each unfolded through the mirrors before it.
    glass : (M, 2) array
        Thickness in metres and refractive index of each.

    Returns
    -------
    offsets : (N, 3) array
        Metres in the camera frame.
    """
    total = np.zeros_like(directions)
    for normal, (thickness, index) in zip(normals, glass):
        cosine = directions @ normal
        total -= (slant(cosine, thickness, index) * cosine)[:, None] * normal
    return total


def straightened(points: Array, normals: Array, glass: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Unfolded points moved so that straight rays from the camera's centre hit their images.

    The ray of a point must start where its own direction says: a fixed point, which is found in a few steps
    because the glass is thin against the way of the light.

    Parameters
    ----------
    points : (N, 3) array
        Points in the camera frame, unfolded through thin mirrors in the front faces.
    normals, glass : (M, 3), (M, 2) arrays
        As in `displacement`.

    Returns
    -------
    moved : (N, 3) array
        Points that the camera projects to the same pixels without glass.
    found : (N,) bool array
        False for a point so near that no ray reaches it.
    """
    moved, directions = points, _unit(points)
    change = np.zeros(len(points))
    for _ in range(_STEPS):
        moved = points - displacement(directions, normals, glass)
        following = _unit(moved)
        change = np.abs(following - directions).max(axis=1, initial=0.0)
        directions = following
        if not np.any(change > _SOLVED):
            break
    return moved, change < 1e-9


def _unit(vectors: Array) -> Array:
    unit: Array = vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)
    return unit
