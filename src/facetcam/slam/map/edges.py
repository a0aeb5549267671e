"""Which map points are corners, and which lie on an edge, along which their patches slide: where it runs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_RADIUS = 7  # px of a patch that count
_KERNEL = (0.25, 0.5, 0.25)
_CORNER = 0.1  # share of the stronger gradient that the weaker one has at a corner, at least
_WHOLE = 0.15  # where it has this share, what is found along it counts in full
_LEAST = 0.1  # of what is found along an edge counts all the same: or nothing might hold a point there


def are_corners(patch: NDArray[np.uint8], offset: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Tell of patches (N, P, P), with their points at offsets (N, 2) from the middle, which show a corner.

    At a corner there are gradients of both directions; along an edge nothing but noise changes.
    """
    values = np.linalg.eigvalsh(_structure(_windows(patch, offset)))
    return np.asarray(values[:, 0] > _CORNER * values[:, 1])


def patch_edges(patch: NDArray[np.uint8], offset: NDArray[np.floating], jacobian: Array) -> Array:
    """Edges that run through patches, in the steps of the world whose images are the columns of `jacobian`.

    Parameters
    ----------
    patch : (N, P, P) array
    offset : (N, 2) array
        Of the point from the central pixel.
    jacobian : (N, 2, 2) array

    Returns
    -------
    (N, 2) array
        Along the edge, of length sqrt(1 - s): s is what counts of an error along it, from one at a corner,
        where gradients of both directions are alike, to a tenth where all of them have one.
    """
    values, vectors = np.linalg.eigh(_structure(_windows(patch, offset)))
    counts = np.clip(values[:, 0] / np.maximum(values[:, 1], 1e-9) / _WHOLE, _LEAST, 1.0)
    along = np.linalg.solve(jacobian, vectors[:, :, :1])[:, :, 0]
    length = np.maximum(np.linalg.norm(along, axis=1), 1e-12)
    return np.asarray(along * (np.sqrt(1.0 - counts) / length)[:, None])


def _windows(patch: NDArray[np.uint8], offset: NDArray[np.floating]) -> Array:
    """The middle of patches round their points, smoothed: what one row of pixels says is noise."""
    column, row = (patch.shape[1] // 2 + np.rint(offset).astype(np.int64)).T[:, :, None]
    span = np.arange(-_RADIUS, _RADIUS + 1)
    w = patch[np.arange(len(patch))[:, None, None], (row + span)[:, :, None], (column + span)[:, None, :]]
    a, b, c = _KERNEL
    rows = a * w[:, :-2] + b * w[:, 1:-1] + c * w[:, 2:]
    return np.asarray(a * rows[:, :, :-2] + b * rows[:, :, 1:-1] + c * rows[:, :, 2:])


def _structure(window: Array) -> Array:
    """Sums (N, 2, 2) of products of gradients."""
    x = window[:, 1:-1, 2:] - window[:, 1:-1, :-2]
    y = window[:, 2:, 1:-1] - window[:, :-2, 1:-1]
    x, y = x.reshape(len(x), x.shape[1] * x.shape[2]), y.reshape(len(y), y.shape[1] * y.shape[2])
    gradient = np.stack([x, y], axis=1)
    return np.asarray(gradient @ np.swapaxes(gradient, 1, 2))
