"""Matching of descriptors: bytes by Hamming distance, floats by Euclidean distance."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from facetcam import _core
from facetcam.errors import FacetcamError

Descriptors = NDArray[np.uint8]
Floats = NDArray[np.float32]
Indices = NDArray[np.int32]

_FARTHEST = 1e9


def match_mutual(
    query: Descriptors | Floats,
    train: Descriptors | Floats,
    ratio: float = 1.0,
    max_distance: float | None = None,
) -> Indices:
    """Match descriptors that are each other's nearest.

    Parameters
    ----------
    query, train : (N, D), (M, D) uint8 or float32
        Descriptors, both of one type.
    ratio : float
        The best distance must be at most this share of the second best; 1 switches the test off.
    max_distance : float, optional
        Greatest distance, in bits or as a length.

    Returns
    -------
    (K, 2) int32
        Rows (query index, train index) in rising query index.

    Raises
    ------
    FacetcamError
        Arrays of wrong type or shape.
    """
    if np.asarray(query).dtype.kind == "f":
        floats = _floats(query, "query")
        nearest = _mutual_of_floats(floats, _floats(train, "train", floats.shape[1]), ratio, max_distance)
    else:
        bits = _descriptors(query, "query")
        others = _descriptors(train, "train", bits.shape[1])
        each = np.arange(len(others), dtype=np.int32)
        nearest = _core.match_mutual(bits, others, each, len(each), _limit(max_distance, bits), float(ratio))
    return _pairs(nearest)


def match_groups(
    query: Descriptors, train: Descriptors, group: ArrayLike, ratio: float, max_distance: int
) -> Indices:
    """Match descriptors to things that several descriptors show: each other's nearest by any of them.

    Parameters
    ----------
    query, train : (N, B), (M, B) uint8
        Binary descriptors of B bytes.
    group : (M,) int
        Thing that each of `train` shows, from 0.
    ratio : float
        The best distance must be at most this share of that to any other thing.
    max_distance : int
        Greatest distance in bits.

    Returns
    -------
    (K, 2) int32
        Rows (query index, thing) in rising query index.

    Raises
    ------
    FacetcamError
        Arrays of wrong type or shape.
    """
    bits = _descriptors(query, "query")
    others, of = _descriptors(train, "train", bits.shape[1]), np.ascontiguousarray(group, np.int32)
    if of.shape != (len(others),) or of.min(initial=0) < 0:
        raise FacetcamError(f"group: expected {len(others)} numbers from 0, got {of.shape}")
    groups = int(of.max(initial=-1)) + 1
    return _pairs(_core.match_mutual(bits, others, of, groups, int(max_distance), float(ratio)))


def _pairs(nearest: Indices) -> Indices:
    """Rows (K, 2) of what has a nearest."""
    matched = np.flatnonzero(nearest >= 0)
    return np.column_stack([matched, nearest[matched]]).astype(np.int32)


def hamming(query: Descriptors, train: Descriptors) -> NDArray[np.int32]:
    """Distances (N, M) in bits between binary descriptors (N, B), (M, B); FacetcamError for other arrays."""
    bits = _descriptors(query, "query")
    return _core.hamming(bits, _descriptors(train, "train", bits.shape[1]))


def mutual_best(
    distances: NDArray[np.integer], ratio: float, max_distance: float
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns of a matrix of distances (N, M) that are each other's best.

    Parameters
    ----------
    distances : (N, M)
        Of all pairs; what must not match is larger than `max_distance`.
    ratio : float
        The best distance of a row must be at most this share of the second best.
    max_distance : float
        Greatest distance.

    Returns
    -------
    rows, columns : (K,) arrays
        In rising order of the rows.
    """
    if not distances.size:
        return np.empty(0, np.intp), np.empty(0, np.intp)
    column, rows = np.argmin(distances, axis=1), np.arange(len(distances))
    best = distances[rows, column]
    good = (np.argmin(distances, axis=0)[column] == rows) & (best <= max_distance)
    if distances.shape[1] > 1:
        good &= best <= ratio * np.partition(distances, 1, axis=1)[:, 1]
    return rows[good], column[good]


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
    query, train = _descriptors(query, "query"), _descriptors(train, "train", np.shape(query)[-1])
    if not (np.isfinite(radius) and radius >= 0):
        raise FacetcamError(f"match_windowed: radius must be a number of pixels >= 0, got {radius}")
    query_places = _places(query_xy, query_view, len(query), "query")
    train_places = _places(train_xy, train_view, len(train), "train")
    return _core.match_windowed(
        query, *query_places, train, *train_places, float(radius), _limit(max_distance, query), float(ratio)
    )


def _mutual_of_floats(query: Floats, train: Floats, ratio: float, max_distance: float | None) -> Indices:
    """For every query its mutually nearest train index, or -1."""
    if min(len(query), len(train)) == 0:
        return np.full(len(query), -1, np.int32)
    distances, nearest = cv2.batchDistance(
        query, train, cv2.CV_32F, normType=cv2.NORM_L2, K=min(2, len(train))
    )
    _, back = cv2.batchDistance(train, query, cv2.CV_32F, normType=cv2.NORM_L2, K=1)
    good = back[nearest[:, 0], 0] == np.arange(len(query))
    if ratio < 1.0 and len(train) > 1:
        good &= distances[:, 0] <= ratio * distances[:, 1]
    if max_distance is not None:
        good &= distances[:, 0] <= max_distance
    return np.where(good, nearest[:, 0], -1).astype(np.int32)


def _floats(given: NDArray[Any], what: str, width: int | None = None) -> Floats:
    array = np.asarray(given)
    if array.dtype.kind != "f" or array.ndim != 2 or (width is not None and array.shape[1] != width):
        raise FacetcamError(
            f"{what} descriptors: expected floats of shape (N, {'D' if width is None else width}), "
            f"got {array.dtype} of shape {array.shape}"
        )
    if not np.isfinite(array).all():
        raise FacetcamError(f"{what} descriptors: expected finite numbers, got NaN or infinity")
    return np.ascontiguousarray(array, np.float32)


def _limit(max_distance: float | None, descriptors: Descriptors) -> int:
    return 8 * descriptors.shape[1] if max_distance is None else int(max_distance)


def _descriptors(given: NDArray[Any], what: str, width: int | None = None) -> Descriptors:
    array = np.asarray(given)
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
