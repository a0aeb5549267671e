"""Repeatability of keypoints between two images of one plane: protocols A, B and C.

Every function takes a homography `H` that maps pixels of the first image to the second and the sizes
(width, height) of the images. Keypoints are sorted, the strongest first.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from facetcam.features import Keypoints

Points = NDArray[np.float64]
Size = tuple[int, int]


@dataclass(frozen=True, slots=True)
class Repeatability:
    """Share of the points found again, their mean distance in pixels, and how many could have been."""

    score: float
    error: float
    count: int


def warp(H: Points, xy: NDArray[np.floating]) -> Points:
    """Map points (N, 2) by a homography (3, 3)."""
    mapped = np.column_stack([xy, np.ones(len(xy))]) @ H.T
    return np.asarray(mapped[:, :2] / mapped[:, 2:])


def inside(xy: Points, size: Size, border: float = 0.0) -> NDArray[np.bool_]:
    """Tell which points lie in an image, at least `border` pixels from its edges."""
    limit = np.array(size) - 1 - border
    return np.asarray(np.all((xy >= border) & (xy <= limit), axis=1))


def one_to_one(
    first: Keypoints,
    second: Keypoints,
    H: Points,
    sizes: tuple[Size, Size],
    top: int = 1000,
    radius: float = 3.0,
    border: float = 15.0,
) -> Repeatability:
    """Protocol B: greedy one-to-one correspondences by distance.

    Of each image the `top` points in the region common to both, less a border, take part. The score is the
    number of pairs nearer than `radius` pixels in the second image over the smaller number of points.
    """
    a, b = _common(first, second, H, sizes, border)
    a, b = warp(H, a[:top]), b[:top]
    count = min(len(a), len(b))
    if count == 0:
        return Repeatability(0.0, np.nan, 0)
    distances = greedy_pairs(a, b, radius)
    error = float(np.mean(distances)) if len(distances) else np.nan
    return Repeatability(len(distances) / count, error, count)


def superpoint(
    first: Keypoints,
    second: Keypoints,
    H: Points,
    sizes: tuple[Size, Size],
    top: int = 300,
    radius: float = 3.0,
) -> Repeatability:
    """Protocol A: many-to-one correspondences by distance, counted both ways.

    As in SuperPoint, https://arxiv.org/abs/1712.07629; images of 240x320 with `H` to match.
    """
    a, b = _common(first, second, H, sizes, 0.0)
    a, b = a[:top], b[:top]
    count = len(a) + len(b)
    if min(len(a), len(b)) == 0:
        return Repeatability(0.0, np.nan, count)
    forth = np.asarray(cKDTree(b).query(warp(H, a))[0])
    back = np.asarray(cKDTree(a).query(warp(_inverse(H), b))[0])
    near = np.concatenate([forth[forth <= radius], back[back <= radius]])
    return Repeatability(len(near) / count, float(near.mean()) if len(near) else np.nan, count)


def greedy_pairs(a: Points, b: Points, radius: float) -> Points:
    """Distances of one-to-one pairs within `radius`, the nearest chosen first."""
    pairs = cKDTree(a).sparse_distance_matrix(cKDTree(b), radius, output_type="ndarray")
    free_a, free_b = np.ones(len(a), bool), np.ones(len(b), bool)
    chosen = []
    for i, j, distance in pairs[np.argsort(pairs["v"], kind="stable")]:
        if free_a[i] and free_b[j]:
            free_a[i] = free_b[j] = False
            chosen.append(distance)
    return np.array(chosen)


def _common(
    first: Keypoints, second: Keypoints, H: Points, sizes: tuple[Size, Size], border: float
) -> tuple[Points, Points]:
    """Points of both images that lie in both images, `border` pixels from the edges."""
    a, b = first.xy.astype(np.float64), second.xy.astype(np.float64)
    seen_a = inside(a, sizes[0], border) & inside(warp(H, a), sizes[1], border)
    seen_b = inside(b, sizes[1], border) & inside(warp(_inverse(H), b), sizes[0], border)
    return a[seen_a], b[seen_b]


def _inverse(H: Points) -> Points:
    return np.asarray(np.linalg.inv(H), np.float64)
