"""Which map points are corners, and which lie on an edge, along which their patches slide."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_RADIUS = 7  # px of a patch that count
_KERNEL = (0.25, 0.5, 0.25)
_CORNER = 0.1  # share of the stronger gradient that the weaker one has at a corner, at least


def are_corners(patch: NDArray[np.uint8], offset: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Tell of patches (N, P, P), with their points at offsets (N, 2) from the middle, which show a corner.

    At a corner there are gradients of both directions; along an edge nothing but noise changes.
    """
    values = np.linalg.eigvalsh(_structure(_windows(patch, offset)))
    return np.asarray(values[:, 0] > _CORNER * values[:, 1])


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
