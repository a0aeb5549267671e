"""Epipolar geometry of one view at two rig poses, and matching of corners along it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from facetcam.features.matching import hamming, mutual_best
from facetcam.geometry import se3
from facetcam.slam.config import SlamConfig
from facetcam.slam.frame import Corners
from facetcam.slam.optics import Optics

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_FAR = 1 << 14  # a Hamming distance that never matches


def epipolar_error(plane_a: Array, plane_b: Array, view: int, T_a_b: Array, optics: Optics) -> Array:
    """Signed Sampson distance in pixels of points seen in one view at two rig poses.

    Parameters
    ----------
    plane_a, plane_b : (..., 2) arrays
        Positions on the view's ideal pinhole; they broadcast.
    T_a_b : (4, 4) or (K, 4, 4) array
        Motion of the rig, or several for (N, 2) positions: the distances are (K, N) then.
    """
    T = optics.T_view_rig[view] @ se3.inverse(T_a_b) @ optics.T_rig_view[view]
    E = se3.skew(T[..., :3, 3]) @ T[..., :3, :3]
    a, b = (
        np.concatenate([p / optics.focal, np.ones((*p.shape[:-1], 1))], axis=-1) for p in (plane_a, plane_b)
    )
    line_b, line_a = a @ np.swapaxes(E, -1, -2), b @ E
    slope2 = line_a[..., 0] ** 2 + line_a[..., 1] ** 2 + line_b[..., 0] ** 2 + line_b[..., 1] ** 2
    return np.asarray(optics.focal * np.sum(b * line_b, axis=-1) / np.sqrt(np.maximum(slope2, 1e-20)))


def match_along_epipolars(
    a: Corners,
    rows_a: Index,
    b: Corners,
    rows_b: Index,
    T_a_b: Array,
    gate: float,
    optics: Optics,
    config: SlamConfig,
) -> tuple[Index, Index]:
    """Match rows of two frames' corners that lie on each other's epipolar lines within `gate` pixels.

    Returns
    -------
    rows_a, rows_b : (M,) arrays
        Mutual best matches that are clearly better than the second best on the line.
    """
    pairs = []
    for view in range(optics.n_views):
        in_a, in_b = rows_a[a.views[rows_a] == view], rows_b[b.views[rows_b] == view]
        if not len(in_a) or not len(in_b):
            continue
        distance = hamming(a.descriptors[in_a], b.descriptors[in_b])
        i, j = np.nonzero(distance <= config.match_distance / config.match_ratio)  # others change no match
        error = epipolar_error(a.plane[in_a[i]], b.plane[in_b[j]], view, T_a_b, optics)
        aside = np.abs(error) > gate
        distance[i[aside], j[aside]] = _FAR
        best_a, best_b = mutual_best(distance, config.match_ratio, config.match_distance)
        pairs.append((in_a[best_a], in_b[best_b]))
    if not pairs:
        return rows_a[:0], rows_b[:0]
    return np.concatenate([p[0] for p in pairs]), np.concatenate([p[1] for p in pairs])
