"""How sharp a photo is: at the corners found in it, or where it is sharpest."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_HALF = 6  # pixels round a corner
_MOST = 200  # corners that are looked at


def blur_of(image: NDArray[np.uint8], pixels: Array) -> float:
    """Median width of the edges at corners, as the sigma of a blurred step in pixels; NaN without corners."""
    widths = _edge_widths(image, pixels[:: max(1, len(pixels) // _MOST)])
    return float(np.median(widths)) if len(widths) else float("nan")


def sharpest_edges(image: NDArray[np.uint8]) -> float:
    """Width in pixels that a tenth of a photo's own corners stay below; NaN where it shows none."""
    found = cv2.goodFeaturesToTrack(image, _MOST, 0.01, 10)
    widths = _edge_widths(image, np.empty((0, 2)) if found is None else found[:, 0].astype(np.float64))
    return float(np.percentile(widths, 10)) if len(widths) else float("nan")


def _edge_widths(image: NDArray[np.uint8], pixels: Array) -> list[float]:
    """Width of the edges at each corner that has contrast.

    A step of height h blurred by sigma has the steepest slope h / (sigma sqrt(2 pi)). The wider of a corner's
    two edges counts, so that a photo smeared in one direction is seen to be.
    """
    widths = []
    for x, y in np.rint(pixels).astype(int):
        patch = image[max(y - _HALF, 0) : y + _HALF + 1, max(x - _HALF, 0) : x + _HALF + 1].astype(np.float32)
        low, high = np.percentile(patch, [5, 95])
        if min(patch.shape) < 2 * _HALF or high - low < 8:
            continue
        slope_x, slope_y = cv2.Sobel(patch, cv2.CV_32F, 1, 0) / 8, cv2.Sobel(patch, cv2.CV_32F, 0, 1) / 8
        # The structure tensor's smaller eigenvalue belongs to the weaker of the two edges.
        xx, yy, xy = (
            float((a * b).mean()) for a, b in ((slope_x, slope_x), (slope_y, slope_y), (slope_x, slope_y))
        )
        weaker = 0.5 * (xx + yy - np.hypot(xx - yy, 2 * xy))
        # An edge through a window of n pixels: mean of slope^2 = h^2 / (2 sqrt(pi) sigma n).
        if weaker > 0:
            widths.append((high - low) ** 2 / (2 * np.sqrt(np.pi) * weaker * len(patch)))
    return widths
