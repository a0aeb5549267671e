"""Corners to a fraction of a pixel, where a prediction says that they are."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from facetcam.calibration.saddle_fit import fit_saddles

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

WINDOW = 0.14  # half side of the window, in squares: a larger one meets the markers beside the corner
LEAST_WINDOW = 2  # pixels
MOST_WINDOW = 20
_RADIUS, _STRIP = 1.4, 0.65  # windows: of the circle that is fitted, and beside its edges
_RINGS = (0.6, 0.9)  # radii in windows at which a corner must look like one
_SAMPLES = 32  # round a ring
_SYMMETRY = 0.35  # largest mean difference of opposite samples, in contrasts
_SETTLED = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 40, 1e-3)


def radius_of(square_px: ArrayLike) -> Array:
    """Radius (N,) in pixels of the circle in which edges are fitted, by the shortest side of a square."""
    return np.asarray(_RADIUS * _window(np.asarray(square_px, dtype=np.float64)))


def _window(square_px: Array) -> NDArray[np.int64]:
    return np.clip(np.rint(WINDOW * square_px), LEAST_WINDOW, MOST_WINDOW).astype(np.int64)


def refine(
    image: NDArray[np.uint8], predicted: ArrayLike, square_px: ArrayLike, contrast: float = 12.0
) -> tuple[Array, Bools]:
    """Find corners, where two dark and two bright quarters meet, near predictions.

    Parameters
    ----------
    image : (H, W) uint8 array
        The raw photo, grey.
    predicted : (N, 2) array
        Pixels.
    square_px : (N,) array
        Shortest side of a square there, in pixels; the window is `WINDOW` of it to each side.
    contrast : float
        Least difference between bright and dark, in grey levels.

    Returns
    -------
    pixels : (N, 2) array
        The corners; the prediction where there is none.
    accepted : (N,) bool array
        False where no corner was found, or where what is there does not look like one all round: a seam
        between two views cuts it, or something hides it.
    """
    start = np.asarray(predicted, dtype=np.float64).reshape(-1, 2)
    wanted = np.broadcast_to(np.asarray(square_px, dtype=np.float64), len(start))
    window = _window(wanted)
    height, width = image.shape
    room = (start >= window[:, None] + 1) & (start <= np.array([width, height]) - 2 - window[:, None])
    inside = np.isfinite(start).all(axis=1) & room.all(axis=1)
    pixels = start.copy()
    for half in np.unique(window[inside]):
        rows = inside & (window == half)
        corners = np.ascontiguousarray(start[rows], dtype=np.float32).reshape(-1, 1, 2)
        found = cv2.cornerSubPix(image, corners.copy(), (int(half),) * 2, (-1, -1), _SETTLED)
        rough = found[:, 0].astype(np.float64)
        fine = fit_saddles(image, rough, _RADIUS * half, max(_STRIP * half, LEAST_WINDOW))
        # What finds no corner gives the prediction back: it must not count as seen.
        rough[(rough == corners[:, 0]).all(axis=1)] = np.inf
        pixels[rows] = np.where(np.isnan(fine), rough, fine)
    accepted = inside & (np.linalg.norm(pixels - start, axis=1) <= 1.5 * window)
    accepted[accepted] = looks_like_corner(image, pixels[accepted], window[accepted], contrast)
    return np.where(accepted[:, None], pixels, start), accepted


def looks_like_corner(image: NDArray[np.uint8], pixels: Array, radius: ArrayLike, contrast: float) -> Bools:
    """Tell round which pixels (N, 2) the image is bright, dark, bright, dark, and the same on opposite sides.

    Nothing of this depends on how the board is turned, tilted or mirrored.
    """
    radius = np.broadcast_to(np.asarray(radius, dtype=np.float64), len(pixels))
    good = np.ones(len(pixels), dtype=bool)
    angle = 2 * np.pi * np.arange(_SAMPLES) / _SAMPLES
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    for ring in _RINGS:
        at = pixels[:, None] + (ring * np.maximum(radius, 2.5))[:, None, None] * circle
        grey = _sampled(image, at)
        low, high = np.percentile(grey, [10, 90], axis=1)
        span = high - low
        bright = grey > (0.5 * (low + high))[:, None]
        changes = np.count_nonzero(bright != np.roll(bright, 1, axis=1), axis=1)
        difference = np.abs(grey - np.roll(grey, _SAMPLES // 2, axis=1)).mean(axis=1)
        good &= (span >= contrast) & (changes == 4) & (difference <= _SYMMETRY * span)
    return good


def _sampled(image: NDArray[np.uint8], at: Array) -> Array:
    """Bilinear grey values (N, M) at pixels (N, M, 2)."""
    if not len(at):
        return np.zeros(at.shape[:2])
    points = at.astype(np.float32)
    # remap takes at most 32767 rows
    parts = [
        cv2.remap(image, part[..., 0], part[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        for part in np.array_split(points, 1 + len(points) // 30000)
    ]
    return np.concatenate(parts).astype(np.float64)
