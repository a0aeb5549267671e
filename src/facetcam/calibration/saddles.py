"""Corners of chessboards anywhere in a photo: where they are, and which way their edges run."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from facetcam.calibration.corners import looks_like_corner
from facetcam.calibration.saddle_fit import edge_directions

Array = NDArray[np.float64]

_BLUR = 1.5  # pixels, of each level
_LEVELS = 3  # each half as large as the one before: large squares out of focus have wide corners
_SEPARATE = 5  # pixels within which the strongest corner stands alone
_RADIUS = 5.0  # pixels of a level: where the edges are looked for
_CONTRAST = 14.0  # least difference of bright and dark, grey levels
_MOST = 6000  # corners of a level; more is texture


@dataclass(frozen=True, eq=False)
class Saddles:
    """Points where two dark and two bright quarters meet.

    Attributes
    ----------
    pixels : (N, 2) array
        To a fraction of a pixel.
    rising, falling : (N,) arrays
        Direction of the edges in radians, modulo pi; turning from x towards y, the image becomes bright at a
        rising edge and dark at a falling one.
    """

    pixels: Array
    rising: Array
    falling: Array


def find_saddles(grey: NDArray[np.uint8]) -> Saddles:
    """Find the saddle points of an 8-bit image (H, W), at several sizes, each once."""
    found: list[tuple[Array, Array, Array]] = []
    level, scale = grey, 1.0
    for _ in range(_LEVELS):
        if min(level.shape) < 40:
            break
        pixels, rising, falling = _of_level(level)
        at = (pixels + 0.5) * scale - 0.5
        if found:
            taken = np.concatenate([f[0] for f in found])
            new = _apart(at, taken, 4.0 * scale)
            at, rising, falling = at[new], rising[new], falling[new]
        found.append((at, rising, falling))
        level, scale = cv2.pyrDown(level), 2.0 * scale
    return Saddles(*(np.concatenate([f[i] for f in found]) for i in range(3)))


def _of_level(grey: NDArray[np.uint8]) -> tuple[Array, Array, Array]:
    smooth = cv2.GaussianBlur(grey.astype(np.float32), (0, 0), _BLUR)
    xx, yy, xy = (cv2.Sobel(smooth, cv2.CV_32F, *order, scale=0.25) for order in ((2, 0), (0, 2), (1, 1)))
    strength = xy * xy - xx * yy
    peak = (strength == cv2.dilate(strength, np.ones((_SEPARATE, _SEPARATE)))) & (strength > 4.0)
    border = int(_RADIUS) + 2
    peak[:border], peak[-border:], peak[:, :border], peak[:, -border:] = (False,) * 4
    v, u = np.nonzero(peak)
    strongest = np.argsort(-strength[v, u], kind="stable")[:_MOST]
    pixels = np.column_stack([u, v]).astype(np.float64)[strongest]
    pixels = pixels[looks_like_corner(grey, pixels, 4.5, _CONTRAST)]
    if not len(pixels):
        return pixels, np.empty(0), np.empty(0)
    criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 20, 1e-3)
    start = pixels.astype(np.float32).reshape(-1, 1, 2)
    refined = cv2.cornerSubPix(grey, start, (4, 4), (-1, -1), criteria)[:, 0].astype(np.float64)
    near = np.linalg.norm(refined - pixels, axis=1) < 3.0
    pixels = refined[near]
    good = looks_like_corner(grey, pixels, _RADIUS, _CONTRAST)
    return pixels[good], *edge_directions(grey, pixels[good], _RADIUS)


def _apart(points: Array, others: Array, distance: float) -> NDArray[np.bool_]:
    if not len(points) or not len(others):
        return np.ones(len(points), dtype=bool)
    return np.asarray(cKDTree(others).query(points)[0] > distance)
