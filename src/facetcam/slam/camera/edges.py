"""Which patches show a corner, and which an edge, along which they slide: where it runs."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam import _core

Array = NDArray[np.float64]

_RADIUS = 7  # px of a patch that count
_KERNEL = (0.25, 0.5, 0.25)
_EDGE = 0.15  # share of the stronger gradient that the weaker one has, below which errors along it count less
_APART = 5.0  # px from which on a patch that looks like itself is found at another place
_OTHER, _SAME = 0.8, 0.9  # correlation with that place, from which on it is hardly another, and none at all
_LEAST = 0.1  # of what is found along an edge counts all the same: or nothing might hold a point there
_CORNER = 0.67  # more than this counts along what is no edge


def are_corners(patch: NDArray[np.uint8], offset: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Tell of patches (N, P, P), with their points at offsets (N, 2) from the middle, which show a corner.

    At a corner there are gradients of both directions; along an edge nothing but noise changes, and a dashed
    line repeats.
    """
    return np.asarray(_sliding(patch, offset)[0] > _CORNER)


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
        Along the edge, of length sqrt(1 - s): s is what counts of an error along it, from one at a corner
        to a tenth where the patch slides.
    """
    counts, way = _sliding(patch, offset)
    along = np.linalg.solve(jacobian, way[:, :, None])[:, :, 0]
    length = np.maximum(np.linalg.norm(along, axis=1), 1e-12)
    return np.asarray(along * (np.sqrt(1.0 - counts) / length)[:, None])


def _sliding(patch: NDArray[np.uint8], offset: NDArray[np.floating]) -> tuple[Array, Array]:
    """What counts (N,) of errors the way (N, 2) that patches slide.

    They slide along an edge, where all gradients have one direction, and where they find themselves again:
    on a dashed line gradients have two.
    """
    share, along = _gradients(_windows(patch, offset))
    by_gradients = np.clip(share / _EDGE, _LEAST, 1.0)
    found = _core.self_similarity(
        np.ascontiguousarray(patch),
        np.ascontiguousarray(offset, dtype=np.float32),
        _RADIUS,
        _APART,
        cv2.getNumThreads(),
    ).astype(np.float64)
    by_likeness = np.clip((_SAME - found[:, 0]) / (_SAME - _OTHER), _LEAST, 1.0)
    way = np.where((by_likeness < by_gradients)[:, None], found[:, 1:], along)
    return np.minimum(by_gradients, by_likeness), way


def _windows(patch: NDArray[np.uint8], offset: NDArray[np.floating]) -> Array:
    """The middle of patches round their points, smoothed: what one row of pixels says is noise."""
    column, row = (patch.shape[1] // 2 + np.rint(offset).astype(np.int64)).T[:, :, None]
    span = np.arange(-_RADIUS, _RADIUS + 1)
    w = patch[np.arange(len(patch))[:, None, None], (row + span)[:, :, None], (column + span)[:, None, :]]
    a, b, c = _KERNEL
    rows = a * w[:, :-2] + b * w[:, 1:-1] + c * w[:, 2:]
    return np.asarray(a * rows[:, :, :-2] + b * rows[:, :, 1:-1] + c * rows[:, :, 2:])


def _gradients(window: Array) -> tuple[Array, Array]:
    """Share (N,) of the stronger gradient that the weaker one has, and the way (N, 2) of the weaker one.

    Eigenvalues of the structure tensor, and an eigenvector.
    """
    x = window[:, 1:-1, 2:] - window[:, 1:-1, :-2]
    y = window[:, 2:, 1:-1] - window[:, :-2, 1:-1]
    xx, xy, yy = (np.sum(product, axis=(1, 2)) for product in (x * x, x * y, y * y))
    middle, apart = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
    stronger = 0.5 * np.arctan2(2.0 * xy, xx - yy)
    way = np.column_stack([-np.sin(stronger), np.cos(stronger)])
    return (middle - apart) / np.maximum(middle + apart, 1e-9), way
