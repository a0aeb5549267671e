"""Matching of described keypoints between two images of one plane: protocol D."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam.evaluation.repeatability import Points, Size, warp


@dataclass(frozen=True, slots=True)
class Matching:
    """Share of right matches by pixel threshold, mean corner error of the homography (px), match count."""

    accuracy: dict[float, float]
    corner_error: float
    count: int


def mutual_nearest(first: NDArray[np.generic], second: NDArray[np.generic], norm: int) -> NDArray[np.intp]:
    """Rows (index in first, index in second) of mutually nearest descriptors, by OpenCV's norm."""
    if min(len(first), len(second)) == 0:
        return np.empty((0, 2), np.intp)
    matches = cv2.BFMatcher(norm, crossCheck=True).match(first, second)
    return np.array([(m.queryIdx, m.trainIdx) for m in matches], np.intp).reshape(-1, 2)


def matching_accuracy(
    first: Points, second: Points, H: Points, size: Size, thresholds: Sequence[float] = (1.0, 3.0, 5.0)
) -> Matching:
    """Judge matched points (M, 2), (M, 2) by the true homography.

    The accuracy at t is the share of matches with ||H a - b|| <= t. The corner error is the mean distance
    between the corners of the first image mapped by the true homography and by one estimated from the matches
    (RANSAC at 3 px); infinite where none can be estimated.
    """
    distance = np.linalg.norm(warp(H, first) - second, axis=1)
    accuracy = {t: float(np.mean(distance <= t)) if len(distance) else 0.0 for t in thresholds}
    return Matching(accuracy, _corner_error(first, second, H, size), len(distance))


def _corner_error(first: Points, second: Points, H: Points, size: Size) -> float:
    if len(first) < 4:
        return np.inf
    cv2.setRNGSeed(0)
    estimate, _ = cv2.findHomography(first, second, cv2.RANSAC, 3.0)
    if estimate is None:
        return np.inf
    width, height = size
    corners = np.array([[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]], np.float64)
    return float(np.linalg.norm(warp(estimate, corners) - warp(H, corners), axis=1).mean())
