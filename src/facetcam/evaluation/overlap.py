"""Repeatability by overlap of regions: protocol C."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from facetcam.evaluation.repeatability import Points, Repeatability, Size, inside, warp
from facetcam.features import Keypoints

_RADIUS = 30.0  # regions are scaled until the reference has the area of this circle, pixels
_REACH = 15.0  # circles of radius 30 further apart than this overlap by less than 0.52
_SAMPLES = 31  # across the square in which an overlap is counted


def overlap_repeatability(
    first: Keypoints,
    second: Keypoints,
    H: Points,
    sizes: tuple[Size, Size],
    top: int = 1000,
    max_error: float = 0.4,
) -> Repeatability:
    """Protocol C: regions of `size` pixels diameter that overlap once mapped by the homography.

    Of each image the `top` regions fully visible in both take part. Both regions of a pair are scaled about
    their centres so that the second has the area of a circle of radius 30; the overlap error is one minus
    intersection over union. Pairs under `max_error` are chosen greedily, the best first; the score is their
    number over the smaller number of regions, the error their mean overlap error.

    Source: K. Mikolajczyk et al., "A comparison of affine region detectors", IJCV 2005.
    """
    first = _visible(first, H, sizes)[:top]
    second = _visible(second, np.asarray(np.linalg.inv(H), np.float64), sizes[::-1])[:top]
    count = min(len(first), len(second))
    if count == 0:
        return Repeatability(0.0, np.nan, 0)
    centres = warp(H, first.xy.astype(np.float64))
    shapes, radii = _circle_maps(H, first), second.size.astype(np.float64) / 2
    near = cKDTree(centres).sparse_distance_matrix(cKDTree(second.xy), _REACH, output_type="ndarray")
    i, j = near["i"], near["j"]
    ratio = np.abs(np.linalg.det(shapes[i])) / radii[j] ** 2  # of the areas; bounds intersection over union
    possible = np.minimum(ratio, 1 / ratio) > 1.0 - max_error
    i, j = i[possible], j[possible]
    errors = _overlap_errors(shapes[i] * (_RADIUS / radii[j])[:, None, None], second.xy[j] - centres[i])
    chosen = _greedy(np.column_stack([i, j]), errors, max_error)
    return Repeatability(len(chosen) / count, float(np.mean(chosen)) if chosen else np.nan, count)


def _visible(keypoints: Keypoints, H: Points, sizes: tuple[Size, Size]) -> Keypoints:
    """Keep the regions whose box lies in their image and, mapped, in the other."""
    radius = keypoints.size[:, None] / 2
    kept = np.ones(len(keypoints), bool)
    for corner in ([1, 1], [1, -1], [-1, 1], [-1, -1]):
        place = keypoints.xy + radius * np.array(corner)
        kept &= inside(place, sizes[0]) & inside(warp(H, place), sizes[1])
    return keypoints[kept]


def _circle_maps(H: Points, keypoints: Keypoints) -> Points:
    """Matrices (N, 2, 2) that map the unit circle to the mapped regions: Jacobian of H times the radius."""
    xy = keypoints.xy.astype(np.float64)
    depth = np.column_stack([xy, np.ones(len(xy))]) @ H[2]
    mapped = warp(H, xy)
    jacobian = (H[None, :2, :2] - mapped[:, :, None] * H[None, 2:, :2]) / depth[:, None, None]
    return np.asarray(jacobian * (keypoints.size[:, None, None] / 2))


def _overlap_errors(shapes: Points, offsets: Points) -> Points:
    """One minus intersection over union of ellipses (N, 2, 2) and circles `offsets` (N, 2) away."""
    axis = np.linspace(-1.0, 1.0, _SAMPLES)
    square = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    errors = np.empty(len(shapes))
    for k, (shape, offset) in enumerate(zip(shapes, offsets, strict=True)):
        grid = square * max(_RADIUS + _REACH, float(np.linalg.norm(shape, 2)))
        in_ellipse = np.sum((grid @ np.linalg.inv(shape).T) ** 2, axis=1) <= 1.0
        in_circle = np.sum((grid - offset) ** 2, axis=1) <= _RADIUS**2
        errors[k] = 1.0 - np.count_nonzero(in_ellipse & in_circle) / np.count_nonzero(in_ellipse | in_circle)
    return errors


def _greedy(pairs: NDArray[np.intp], errors: Points, max_error: float) -> list[float]:
    """Errors of one-to-one pairs under the limit, the best chosen first."""
    used: tuple[set[int], set[int]] = (set(), set())
    chosen = []
    for k in np.argsort(errors, kind="stable"):
        i, j = pairs[k].tolist()
        if errors[k] >= max_error:
            break
        if i not in used[0] and j not in used[1]:
            used[0].add(i)
            used[1].add(j)
            chosen.append(float(errors[k]))
    return chosen
