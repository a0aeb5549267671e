"""Epipolar geometry of views at two rig poses, and matching of corners along it."""

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
Candidates = tuple[Index, Index, NDArray[np.int32]]  # corners of either side, and bits by which they differ

_FAR = 1 << 14  # a Hamming distance that never matches


def epipolar_error(
    plane_a: Array, plane_b: Array, view: int, T_a_b: Array, optics: Optics, view_b: int | None = None
) -> Array:
    """Signed Sampson distance in pixels of points seen in one view, or two, at two rig poses.

    Parameters
    ----------
    plane_a, plane_b : (..., 2) arrays
        Positions on the ideal pinholes of their views; they broadcast.
    view : int
    T_a_b : (4, 4) or (K, 4, 4) array
        Motion of the rig, or several for (N, 2) positions: the distances are (K, N) then.
    view_b : int, optional
        Through which b is seen, if it is another one.
    """
    T = optics.T_view_rig[view if view_b is None else view_b] @ se3.inverse(T_a_b) @ optics.T_rig_view[view]
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
    views = np.intersect1d(a.views[rows_a], b.views[rows_b]).tolist()
    sides = [_candidates(a, v, b, v, T_a_b, gate, optics, config) for v in views]
    return _unmistakable(sides, rows_a, rows_b, config)


def match_across_views(
    corners: Corners, rows: Index, optics: Optics, config: SlamConfig
) -> tuple[Index, Index]:
    """Match rows of a frame's corners between its views that overlap; as `match_along_epipolars`."""
    here, gate = np.eye(4), config.gate
    sides = [_candidates(corners, v, corners, w, here, gate, optics, config) for v, w in optics.overlapping]
    return _unmistakable(sides, rows, rows, config)


def _candidates(
    a: Corners,
    view_a: int,
    b: Corners,
    view_b: int,
    T_a_b: Array,
    gate: float,
    optics: Optics,
    config: SlamConfig,
) -> Candidates:
    """Corners of two views that look somewhat alike and lie on each other's epipolar lines."""
    in_a, in_b = np.flatnonzero(a.views == view_a), np.flatnonzero(b.views == view_b)
    distance = hamming(a.descriptors[in_a], b.descriptors[in_b])
    # Bits beyond this change no match: the second best is clear of the best then.
    alike = np.flatnonzero(distance <= config.match_distance / config.match_ratio)
    i, j = np.divmod(alike, max(len(in_b), 1))
    error = epipolar_error(a.plane[in_a[i]], b.plane[in_b[j]], view_a, T_a_b, optics, view_b)
    i, j = (side[np.abs(error) <= gate] for side in (i, j))
    return in_a[i], in_b[j], distance[i, j]


def _unmistakable(
    sides: list[Candidates], rows_a: Index, rows_b: Index, config: SlamConfig
) -> tuple[Index, Index]:
    """Rows of candidates that are each other's best, and clearly better than the second best."""
    if not sides:
        return rows_a[:0], rows_b[:0]
    a, b, bits = (np.concatenate(side) for side in zip(*sides))
    matched = _clearly_best(a, bits, config) & _clearly_best(b, bits, config)
    matched &= np.isin(a, rows_a) & np.isin(b, rows_b)
    return a[matched], b[matched]


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
