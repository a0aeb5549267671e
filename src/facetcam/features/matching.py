"""Matching of binary descriptors by Hamming distance."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from facetcam import _core
from facetcam.errors import FacetcamError

Descriptors = NDArray[np.uint8]
Indices = NDArray[np.int32]

_FARTHEST = 1e9


def match_mutual(
    query: Descriptors, train: Descriptors, ratio: float = 1.0, max_distance: int | None = None
) -> Indices:
    """Match descriptors that are each other's nearest.

    Parameters
    ----------
    query, train : (N, B), (M, B) uint8
        Binary descriptors of B bytes.
    ratio : float
        The best distance must be at most this share of the second best; 1 switches the test off.
    max_distance : int, optional
        Greatest distance in bits.

    Returns
    -------
    (K, 2) int32
        Rows (query index, train index) in rising query index.

    Raises
    ------
    FacetcamError
        Arrays of wrong type or shape.
    """
    query, train = _descriptors(query, "query"), _descriptors(train, "train", query.shape[-1])
    nearest = _core.match_mutual(query, train, _limit(max_distance, query), float(ratio))
    matched = np.flatnonzero(nearest >= 0)
    return np.column_stack([matched, nearest[matched]]).astype(np.int32)


def match_windowed(
    query: Descriptors,
    query_xy: ArrayLike,
    query_view: ArrayLike,
    train: Descriptors,
    train_xy: ArrayLike,
    train_view: ArrayLike,
    radius: float,
    max_distance: int | None = None,
    ratio: float = 1.0,
) -> Indices:
    """Match every query inside a window round its predicted place, within its view.

    Parameters
    ----------
    query, train : (N, B), (M, B) uint8
        Binary descriptors of B bytes.
    query_xy, train_xy : (N, 2), (M, 2)
        Predicted and found places, pixels.
    query_view, train_view : (N,), (M,) int
        Index of the view; only points of the same view match.
    radius : float
        Search radius, pixels.
    max_distance : int, optional
        Greatest distance in bits.
    ratio : float
        The best distance in the window must be at most this share of the second best.

    Returns
    -------
    (N,) int32
        Index into `train` or -1. Every train point is used at most once; the nearest query gets it.

    Raises
    ------
    FacetcamError
        Arrays of wrong type or shape, places that are not finite, or a negative radius.
    """
    query, train = _descriptors(query, "query"), _descriptors(train, "train", query.shape[-1])
    if not (np.isfinite(radius) and radius >= 0):
        raise FacetcamError(f"match_windowed: radius must be a number of pixels >= 0, got {radius}")
    query_places = _places(query_xy, query_view, len(query), "query")
    train_places = _places(train_xy, train_view, len(train), "train")
    return _core.match_windowed(
        query, *query_places, train, *train_places, float(radius), _limit(max_distance, query), float(ratio)
    )


def _limit(max_distance: int | None, descriptors: Descriptors) -> int:
    return 8 * descriptors.shape[1] if max_distance is None else int(max_distance)


def _descriptors(array: Descriptors, what: str, width: int | None = None) -> Descriptors:
    array = np.asarray(array)
    if array.dtype != np.uint8 or array.ndim != 2 or (width is not None and array.shape[1] != width):
        wanted = f"(N, {'bytes' if width is None else width})"
        raise FacetcamError(
            f"{what} descriptors: expected uint8 of shape {wanted}, got {array.dtype} of shape {array.shape}"
        )
    return np.ascontiguousarray(array)


def _places(xy: ArrayLike, view: ArrayLike, count: int, what: str) -> tuple[NDArray[np.float32], Indices]:
    places = np.ascontiguousarray(xy, np.float32)
    views = np.ascontiguousarray(view, np.int32)
    if places.shape != (count, 2) or views.shape != (count,):
        raise FacetcamError(
            f"{what}: expected xy of shape ({count}, 2) and view of shape ({count},), "
            f"got {places.shape} and {views.shape}"
        )
    if not (np.abs(places) < _FARTHEST).all():
        raise FacetcamError(
            f"{what}_xy: has places that are NaN or beyond {_FARTHEST:g} pixels; leave them out"
        )
    return places, views
