"""Local maxima of response maps, for the detectors that are not native."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam.features.images import Mask
from facetcam.features.keypoints import Keypoints

Maps = NDArray[np.floating]
Rows = NDArray[np.float32]
Points = NDArray[np.float64]

_SQUARE = np.ones((3, 3), np.uint8)


def local_maxima(maps: Maps, threshold: float) -> NDArray[np.bool_]:
    """Mark the values of maps (S, H, W) above the threshold and not below any of their 26 neighbours."""
    wide = np.stack([cv2.dilate(layer, _SQUARE) for layer in maps])
    highest = wide.copy()
    np.maximum(highest[1:], wide[:-1], out=highest[1:])
    np.maximum(highest[:-1], wide[1:], out=highest[:-1])
    return np.asarray((maps >= highest) & (maps > threshold))


def refine(layer: Maps, row: NDArray[np.intp], column: NDArray[np.intp]) -> Points:
    """Sub-pixel peaks (N, 2) x, y of the quadratics through the 3x3 neighbourhoods of inner pixels."""
    near = {(i, j): layer[row + j, column + i].astype(np.float64) for i in (-1, 0, 1) for j in (-1, 0, 1)}
    gx, gy = (near[1, 0] - near[-1, 0]) / 2, (near[0, 1] - near[0, -1]) / 2
    xx = near[1, 0] + near[-1, 0] - 2 * near[0, 0]
    yy = near[0, 1] + near[0, -1] - 2 * near[0, 0]
    xy = (near[1, 1] + near[-1, -1] - near[-1, 1] - near[1, -1]) / 4
    det = xx * yy - xy**2
    safe = np.where(det > 0, det, np.inf)
    offset = np.column_stack([(xy * gy - yy * gx) / safe, (xy * gx - xx * gy) / safe])
    return np.asarray(np.column_stack([column, row]) + np.clip(offset, -0.5, 0.5), np.float64)


def strongest(rows: Rows, mask: Mask | None, max_features: int | None) -> Keypoints:
    """Keypoints from rows (N, 6) in falling response, then y, then x; masked ones and the rest dropped."""
    if mask is not None:
        column, row = np.rint(rows[:, :2]).astype(np.intp).T
        rows = rows[mask[row, column] > 0]
    order = np.lexsort((rows[:, 0], rows[:, 1], -rows[:, 4]))
    return Keypoints.from_rows(rows[order[:max_features]])
