"""SIICF as printed: equations 1-5 of the paper.

Where the paper is silent, this is chosen: gradients are central differences, sigma_I is sigma_D / 0.7 (as in
its reference on Harris-Laplace), a local maximum is one in space and among the scales of its down-sampled
image, and F is clipped to the 8 bits of a camera, without which eta would change nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam.features.images import Image
from facetcam.features.orientation import centroid_angles
from facetcam.features.peaks import Points, Rows, local_maxima, refine

Map = NDArray[np.float32]

INTEGRATION_RATIO = 1.0 / 0.7  # sigma_I / sigma_D
_SMALLEST_SIDE = 16


@dataclass(frozen=True, slots=True)
class PaperParameters:
    """What equations 1-5 leave open; the names are those of `SIICFOptions`."""

    scales: int
    levels: int
    sigma: float
    k: float
    etas: tuple[float, ...]
    alpha: float
    threshold: float

    @property
    def sigmas(self) -> list[float]:
        """Differentiation scales of one down-sampled image: sigma, k sigma, ..."""
        return [self.sigma * self.k**level for level in range(self.levels)]


def paper_rows(grey: Image, parameters: PaperParameters) -> Rows:
    """Find corners; rows (N, 6) x, y, size, angle, response, level, in no order.

    The level of a corner is `levels` * octave + index of its scale.
    """
    down = as_grey_values(grey)
    found = [np.empty((0, 6), np.float32)]
    for octave in range(parameters.scales):
        if min(down.shape) < _SMALLEST_SIDE:
            break
        step = np.array(grey.shape[::-1]) / down.shape[::-1]
        for level, places, response in _corners_of(down, parameters):
            rows = np.empty((len(response), 6), np.float32)
            rows[:, :2] = (places + 0.5) * step - 0.5
            rows[:, 2] = 6.0 * INTEGRATION_RATIO * parameters.sigmas[level] * step.mean()
            rows[:, 3] = centroid_angles(down, places)
            rows[:, 4], rows[:, 5] = response, parameters.levels * octave + level
            found.append(rows)
        half = ((down.shape[1] + 1) // 2, (down.shape[0] + 1) // 2)
        down = np.asarray(cv2.resize(down, half, interpolation=cv2.INTER_AREA))
    return np.concatenate(found)


def as_grey_values(grey: Image) -> Map:
    """Values from 0 to 255 as float32; float images up to 1 are taken to run from 0 to 1."""
    if grey.dtype == np.uint16:
        return grey.astype(np.float32) / np.float32(257)
    if grey.dtype == np.float32 and grey.max() <= 1.0:
        return grey * np.float32(255)
    return grey.astype(np.float32)


def corner_measure(F: Map, sigma: float, alpha: float) -> Map:
    """Blur F (equation 2), form the scale-adapted second moment matrix (4) and its corner measure f (5)."""
    B = _gaussian(F, sigma)
    Lx = cv2.filter2D(B, -1, np.array([[-0.5, 0.0, 0.5]]), borderType=cv2.BORDER_REFLECT_101)
    Ly = cv2.filter2D(B, -1, np.array([[-0.5], [0.0], [0.5]]), borderType=cv2.BORDER_REFLECT_101)
    h11, h12, h22 = (sigma**2 * _gaussian(p, sigma * INTEGRATION_RATIO) for p in (Lx * Lx, Lx * Ly, Ly * Ly))
    return np.asarray(h11 * h22 - h12 * h12 - alpha * (h11 + h22) ** 2, np.float32)


def _corners_of(down: Map, parameters: PaperParameters) -> list[tuple[int, Points, Map]]:
    """Level, places (N, 2) and responses of corners that most of the shifted copies agree on."""
    votes = np.zeros((parameters.levels, *down.shape), np.uint8)
    best = np.zeros(votes.shape, np.float32)
    for eta in parameters.etas:
        F = np.clip(down + np.float32(eta), 0, 255)  # equation 1
        measures = np.stack([corner_measure(F, sigma, parameters.alpha) for sigma in parameters.sigmas])
        votes += local_maxima(measures, parameters.threshold)
        np.maximum(best, measures, out=best)
    kept = votes > len(parameters.etas) // 2
    kept[:, [0, -1]] = kept[:, :, [0, -1]] = False
    corners = []
    for level in range(parameters.levels):
        row, column = np.nonzero(kept[level])
        corners.append((level, refine(best[level], row, column), best[level, row, column]))
    return corners


def _gaussian(image: Map, sigma: float) -> Map:
    side = 2 * int(np.ceil(3.0 * sigma)) + 1
    return np.asarray(cv2.GaussianBlur(image, (side, side), sigma, borderType=cv2.BORDER_REFLECT_101))
