"""Epipolar geometry of one view at two rig poses, and matching of corners along it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from facetcam.features.matching import hamming
from facetcam.geometry import se3
from facetcam.slam.camera.frame import Corners
from facetcam.slam.camera.optics import Optics
from facetcam.slam.config import SlamConfig

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
        Mutual best matches that are clearly better than the second best on the line, in either frame. The
        corners of all other rows count there: a pattern that repeats is mistaken for its neighbour as soon
        as that one is left out.
    """
    sides = []
    for view in np.intersect1d(a.views[rows_a], b.views[rows_b]).tolist():
        in_a, in_b = np.flatnonzero(a.views == view), np.flatnonzero(b.views == view)
        distance = hamming(a.descriptors[in_a], b.descriptors[in_b])
        # Bits beyond this change no match: the second best is clear of the best then.
        alike = np.flatnonzero(distance <= config.match_distance / config.match_ratio)
        i, j = np.divmod(alike, len(in_b))
        error = epipolar_error(a.plane[in_a[i]], b.plane[in_b[j]], view, T_a_b, optics)
        i, j = (side[np.abs(error) <= gate] for side in (i, j))
        sides.append((in_a[i], in_b[j], distance[i, j]))
    if not sides:
        return rows_a[:0], rows_b[:0]
    a_rows, b_rows, bits = (np.concatenate(side) for side in zip(*sides))
    matched = _clearly_best(a_rows, bits, config) & _clearly_best(b_rows, bits, config)
    matched &= np.isin(a_rows, rows_a) & np.isin(b_rows, rows_b)
    return a_rows[matched], b_rows[matched]


def _clearly_best(corner: Index, bits: NDArray[np.int32], config: SlamConfig) -> NDArray[np.bool_]:
    """Pairs (N,) that are the best of their corner, and clearly better than its second best."""
    order = np.lexsort((bits, corner))
    same = corner[order][1:] == corner[order][:-1]
    bits = bits[order]
    second = np.where(np.append(same, False), np.append(bits[1:], _FAR), _FAR)
    good = (bits <= config.match_distance) & (bits <= config.match_ratio * second)
    good[1:] &= ~same
    best = np.empty(len(order), dtype=bool)
    best[order] = good
    return best
