"""Places: which keyframes saw what a frame sees, whatever the heading and through whichever mirror.

Corners are indexed one by one, not as pictures of whole frames, so a place that the front mirror showed is
found again in the left one. The index needs no vocabulary: descriptors that agree in one of several random
sets of bits (locality-sensitive hashing, P. Indyk, R. Motwani, "Approximate nearest neighbors", STOC 1998)
are compared in full. It grows by sorted blocks that are merged when they are of a size, so adding is cheap.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from facetcam.features.descriptors import DESCRIPTOR_BYTES
from facetcam.features.matching import match_groups
from facetcam.slam.map.map import Keyframe

Index = NDArray[np.int64]
Descriptors = NDArray[np.uint8]
Scores = NDArray[np.float64]

_TABLES = 12
_KEY_BITS = 16
_SAME_CORNER = 2.0  # px between a measured point and the corner that describes it
_COMMON = 64  # rows that share a key, beyond which the key says nothing


@dataclass(frozen=True, slots=True)
class Sightings:
    """Map points as keyframes saw them, one row a corner.

    Attributes
    ----------
    point : (N,) ids
    keyframe : (N,) indices
    descriptor : (N, D) uint8
    """

    point: Index
    keyframe: Index
    descriptor: Descriptors

    @classmethod
    def none(cls) -> Sightings:
        """Nothing seen."""
        return cls(np.empty(0, np.int64), np.empty(0, np.int64), np.empty((0, DESCRIPTOR_BYTES), np.uint8))

    @classmethod
    def of(cls, keyframe: Keyframe) -> Sightings:
        """Describe the observations of a keyframe by its corners that lie where they were measured."""
        from scipy.spatial import cKDTree

        seen, corners = keyframe.observations, keyframe.corners
        if not len(seen) or not len(corners):
            return cls.none()
        distance, nearest = (np.asarray(a) for a in cKDTree(corners.pixels).query(seen.pixels))
        rows = np.flatnonzero((distance < _SAME_CORNER) & (corners.views[nearest] == seen.view))
        index = np.full(len(rows), keyframe.index, np.int64)
        return cls(seen.point[rows], index, corners.descriptors[nearest[rows]])

    def __len__(self) -> int:
        return len(self.point)

    def take(self, rows: NDArray[np.generic]) -> Sightings:
        """Some of the rows."""
        return Sightings(self.point[rows], self.keyframe[rows], self.descriptor[rows])

    def joined(self, other: Sightings) -> Sightings:
        """These rows, then those of another."""
        return Sightings(
            np.concatenate([self.point, other.point]),
            np.concatenate([self.keyframe, other.keyframe]),
            np.concatenate([self.descriptor, other.descriptor]),
        )


@dataclass(frozen=True, slots=True)
class _Block:
    """Some sightings, with the order (T, n) of their keys (T, n) in each table."""

    sightings: Sightings
    keys: NDArray[np.uint16]
    order: NDArray[np.int32]

    @classmethod
    def of(cls, sightings: Sightings) -> _Block:
        keys = _keys(sightings.descriptor)
        order = np.argsort(keys, axis=1, kind="stable").astype(np.int32)
        return cls(sightings, np.take_along_axis(keys, order, axis=1), order)

    def search(self, keys: NDArray[np.uint16]) -> tuple[Index, Index]:
        """Rows of the queries (T, Q) and of the sightings that share a key, once for each of its tables."""
        queries, rows = [], []
        for table in range(_TABLES):
            low = np.searchsorted(self.keys[table], keys[table], side="left")
            count = np.searchsorted(self.keys[table], keys[table], side="right") - low
            count[count > _COMMON] = 0
            query = np.repeat(np.arange(len(low)), count)
            within = np.arange(len(query)) - np.repeat(np.cumsum(count) - count, count)
            queries.append(query)
            rows.append(self.order[table][low[query] + within].astype(np.int64))
        return np.concatenate(queries), np.concatenate(rows)


class Places:
    """An index of sightings that tells which keyframes resemble a frame."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self._blocks: list[_Block] = []
        self.indexed = 0  # keyframes below this index are in

    def moved_out(self) -> Places:
        """An index with all that this one holds, which is empty then."""
        other = Places()
        other._blocks, other.indexed = self._blocks, self.indexed
        self.clear()
        return other

    def join(self, earlier: Places, ids_ahead: int, first: int) -> None:
        """Take in the index of another map.

        The ids of its points are larger here by so many, and our keyframes begin at `first`.
        """
        theirs, ours, indexed = earlier.sightings, self.sightings, first + self.indexed
        theirs = replace(theirs, point=theirs.point + ids_ahead)
        self.clear()
        self.restore(theirs.joined(replace(ours, keyframe=ours.keyframe + first)), indexed)

    def add(self, keyframe: Keyframe) -> None:
        """Index what a keyframe saw; keyframes come in the order of their indices."""
        self.restore(Sightings.of(keyframe), keyframe.index + 1)

    def restore(self, sightings: Sightings, indexed: int) -> None:
        """Index sightings of all keyframes below `indexed` that are not in yet."""
        self.indexed = indexed
        if not len(sightings):
            return
        while self._blocks and len(self._blocks[-1].sightings) <= 2 * len(sightings):
            sightings = self._blocks.pop().sightings.joined(sightings)
        self._blocks.append(_Block.of(sightings))

    @property
    def sightings(self) -> Sightings:
        """All that is indexed."""
        return self._gather(lambda s: np.ones(len(s), bool))

    def of_keyframes(self, keyframes: Index) -> Sightings:
        """What these keyframes saw."""
        return self._gather(lambda s: np.isin(s.keyframe, keyframes))

    def replace_points(self, old: Index, new: Index) -> None:
        """Call points `old` (N,) by the ids `new` (N,) into which they were merged."""
        for block in self._blocks:
            ids = block.sightings.point
            where = np.searchsorted(old, ids)
            hit = (where < len(old)) & (old[np.minimum(where, len(old) - 1)] == ids)
            ids[hit] = new[where[hit]]

    def resembling(self, descriptors: Descriptors, n_keyframes: int, max_distance: int) -> Scores:
        """Score (n_keyframes,) of each keyframe: descriptors that it shares, rare ones counting more."""
        score = np.zeros(n_keyframes)
        queries, keyframes = self._hits(descriptors, max_distance)
        if not len(queries):
            return score
        pairs = np.unique(queries * n_keyframes + keyframes)  # a corner votes once for a keyframe
        query, keyframe = pairs // n_keyframes, pairs % n_keyframes
        spread = np.bincount(query, minlength=len(descriptors))
        np.add.at(score, keyframe, np.log1p(n_keyframes / spread[query]))
        return score

    def _hits(self, descriptors: Descriptors, max_distance: int) -> tuple[Index, Index]:
        """Rows of the queries, and keyframes that saw nearly the same."""
        keys = _keys(descriptors)
        queries, keyframes = [np.empty(0, np.int64)], [np.empty(0, np.int64)]
        for block in self._blocks:
            query, row = block.search(keys)
            near = _bits(descriptors[query], block.sightings.descriptor[row]) <= max_distance
            queries.append(query[near])
            keyframes.append(block.sightings.keyframe[row[near]])
        return np.concatenate(queries), np.concatenate(keyframes)

    def _gather(self, chosen: Callable[[Sightings], NDArray[np.bool_]]) -> Sightings:
        found = Sightings.none()
        for block in self._blocks:
            found = found.joined(block.sightings.take(chosen(block.sightings)))
        return found


def match_points(
    query: Descriptors, sightings: Sightings, ratio: float, max_distance: int
) -> tuple[Index, Index]:
    """Match corners to points of which several sightings may be known.

    Parameters
    ----------
    query : (N, D) uint8 array
    sightings : Sightings
    ratio : float
        The best distance must be at most this share of that to any other point.
    max_distance : int
        Bits.

    Returns
    -------
    rows, points : (M,) arrays
        Query rows with the ids of the points that are each other's best.
    """
    if not len(query) or not len(sightings):
        return np.empty(0, np.int64), np.empty(0, np.int64)
    points, group = np.unique(sightings.point, return_inverse=True)
    rows, column = match_groups(query, sightings.descriptor, group, ratio, max_distance).T
    return rows, points[column]


def _keys(descriptors: Descriptors) -> NDArray[np.uint16]:
    """Keys (T, N): 16 bits of the descriptors, others in each table."""
    bits = np.unpackbits(descriptors, axis=1)[:, _CHOSEN]
    return np.ascontiguousarray(np.packbits(bits, axis=2).view(np.uint16)[:, :, 0].T)


def _bits(a: Descriptors, b: Descriptors) -> NDArray[np.int64]:
    """Hamming distances (N,) of rows."""
    words_a, words_b = (np.ascontiguousarray(d).view(np.uint64) for d in (a, b))
    return np.asarray(np.bitwise_count(words_a ^ words_b).sum(axis=1, dtype=np.int64))


_CHOSEN = np.stack(
    [np.random.default_rng(t).permutation(8 * DESCRIPTOR_BYTES)[:_KEY_BITS] for t in range(_TABLES)]
)
