"""The detectors that the paper compares SIICF with, behind the same interface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from facetcam.features.descriptors import as_bytes
from facetcam.features.detector import MOST_FEATURES, Detector, require
from facetcam.features.images import Image, Mask
from facetcam.features.keypoints import Keypoints
from facetcam.features.orientation import centroid_angles
from facetcam.features.peaks import Rows, local_maxima, refine, strongest


def _check(owner: str, max_features: int | None, threshold: float) -> None:
    if max_features is not None:
        require(owner, "max_features", max_features, 1)
    require(owner, "threshold", threshold, 0.0)


@dataclass(frozen=True, slots=True)
class LoGOptions:
    """Parameters of `LoG`.

    Attributes
    ----------
    max_features : int or None
        The strongest are kept; None keeps all.
    threshold : float
        Least scale-normalised |sigma^2 Laplacian| in grey steps of 255.
    sigma, k : float
        Finest scale in pixels and the ratio between scales.
    levels : int
        Number of scales; the outer two only bound the others.
    """

    max_features: int | None = 1000
    threshold: float = 10.0
    sigma: float = 1.6
    k: float = 1.4
    levels: int = 8

    def __post_init__(self) -> None:
        _check("LoG", self.max_features, self.threshold)
        require("LoG", "sigma", self.sigma, 0.5, 10.0)
        require("LoG", "k", self.k, 1.05, 3.0)
        require("LoG", "levels", self.levels, 3, 20)


class LoG(Detector):
    """Extrema of the scale-normalised Laplacian of Gaussian in space and scale (Lindeberg 1998)."""

    Options = LoGOptions
    options: LoGOptions

    def _detect(self, grey: Image, mask: Mask | None) -> Keypoints:
        options, image = self.options, as_bytes(grey).astype(np.float32)
        sigmas = [options.sigma * options.k**level for level in range(options.levels)]
        maps = np.stack(
            [s**2 * cv2.Laplacian(cv2.GaussianBlur(image, (0, 0), s), -1, ksize=1) for s in sigmas]
        )
        np.abs(maps, out=maps)
        kept = local_maxima(maps, options.threshold)
        kept[:, [0, -1]] = kept[:, :, [0, -1]] = False
        found = [np.empty((0, 6), np.float32)]
        for level in range(1, options.levels - 1):
            row, column = np.nonzero(kept[level])
            rows = np.empty((len(row), 6), np.float32)
            rows[:, :2] = refine(maps[level], row, column)
            rows[:, 2] = 2.0 * np.sqrt(2.0) * sigmas[level]  # diameter of the blob that answers most
            rows[:, 3] = centroid_angles(image, rows[:, :2])
            rows[:, 4], rows[:, 5] = maps[level, row, column], level
            found.append(rows)
        return strongest(np.concatenate(found), mask, options.max_features)


@dataclass(frozen=True, slots=True)
class DoGOptions:
    """Parameters of `DoG`: the contrast threshold of SIFT and the number of features."""

    max_features: int | None = 1000
    threshold: float = 0.04

    def __post_init__(self) -> None:
        _check("DoG", self.max_features, self.threshold)


class DoG(Detector):
    """Extrema of the difference of Gaussians: the detector inside OpenCV's SIFT, one point a place."""

    Options = DoGOptions
    options: DoGOptions

    def _detect(self, grey: Image, mask: Mask | None) -> Keypoints:
        # Without the precise upscaling OpenCV's places are a quarter of a pixel off.
        sift = cv2.SIFT.create(contrastThreshold=self.options.threshold, enable_precise_upscale=True)
        rows = _rows_of(sift.detect(as_bytes(grey), None))
        _, first = np.unique(rows[:, :3], axis=0, return_index=True)  # SIFT repeats a place by direction
        return strongest(rows[first], mask, self.options.max_features)


@dataclass(frozen=True, slots=True)
class HarrisLaplaceOptions:
    """Parameters of `HarrisLaplace`: OpenCV's corner threshold and the number of features."""

    max_features: int | None = 1000
    threshold: float = 0.01

    def __post_init__(self) -> None:
        _check("HarrisLaplace", self.max_features, self.threshold)


class HarrisLaplace(Detector):
    """Harris corners at the scale of the greatest Laplacian: OpenCV's HarrisLaplaceFeatureDetector."""

    Options = HarrisLaplaceOptions
    options: HarrisLaplaceOptions

    def _detect(self, grey: Image, mask: Mask | None) -> Keypoints:
        image = as_bytes(grey)
        detector = cv2.xfeatures2d.HarrisLaplaceFeatureDetector.create(
            corn_thresh=self.options.threshold,
            maxCorners=min(self.options.max_features or MOST_FEATURES, MOST_FEATURES),
        )
        rows = _rows_of(detector.detect(image, None))
        rows[:, 3] = centroid_angles(image, rows[:, :2])
        return strongest(rows, mask, self.options.max_features)


def _laplacian(image: Image, sigma: float) -> Image:
    """Size of the scale-normalised Laplacian of Gaussian."""
    blurred = cv2.GaussianBlur(image, (0, 0), sigma)
    return np.asarray(np.abs(sigma**2 * cv2.Laplacian(blurred, -1, ksize=1)))


def _rows_of(keypoints: Any) -> Rows:
    """Rows (N, 6) of OpenCV's keypoints; the level is the lowest byte of the octave."""
    rows = [(*p.pt, p.size, p.angle, p.response, p.octave & 255) for p in keypoints]
    return np.array(rows, np.float32).reshape(-1, 6)
