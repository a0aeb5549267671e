"""Where boards that are fixed to each other stand, from photos that show two of them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from facetcam.calibration.candidates import Candidate
from facetcam.calibration.sightings import Sighting
from facetcam.calibration.votes import Votes, distance_of
from facetcam.geometry import se3

Array = NDArray[np.float64]
Index = NDArray[np.int64]


def constellation(
    count: int, sightings: Sequence[Sighting], candidates: Sequence[list[Candidate]]
) -> tuple[Array, Index]:
    """Poses of boards fixed to each other, in the frame of the first of each set that was seen together.

    Returns the poses (B, 4, 4), and for each board the first board of its set.
    """
    relations = _relations(sightings, candidates)
    voted = {pair: votes.winner() for pair, votes in relations.items()}
    T = np.tile(np.eye(4), (count, 1, 1))
    part = np.arange(count)
    for pair in sorted(voted, key=lambda pair: (-voted[pair][1], pair)):
        a, b = pair
        if part[a] == part[b]:
            continue
        # The set of b joins that of a: all its boards are moved into the frame of a's first board.
        first, other, moving = part[a], part[b], part == part[b]
        T_first_other = T[a] @ voted[pair][0] @ se3.inverse(T[b])
        T[moving], part[moving] = T_first_other @ T[moving], first
        assert part[b] == first != other
    return _from_first(T, part)


def _from_first(T: Array, part: Index) -> tuple[Array, Index]:
    """Put the origin of every set into its board of the lowest index."""
    for name in np.unique(part):
        rows = np.flatnonzero(part == name)
        T[rows] = se3.inverse(T[rows[0]]) @ T[rows]
        part[rows] = rows[0]
    return T, part


def _relations(
    sightings: Sequence[Sighting], candidates: Sequence[list[Candidate]]
) -> dict[tuple[int, int], Votes]:
    """Where photos say that the second of two boards stands from the first, with distances to scale by."""
    found: dict[tuple[int, int], Votes] = {}
    for i, j in combinations(range(len(sightings)), 2):
        if sightings[i].photo != sightings[j].photo or sightings[i].board == sightings[j].board:
            continue
        a, b = (i, j) if sightings[i].board < sightings[j].board else (j, i)
        votes = found.setdefault((sightings[a].board, sightings[b].board), Votes())
        for one in candidates[a]:
            for other in candidates[b]:
                distance = distance_of(one.T_rig_board) + distance_of(other.T_rig_board)
                votes.add(
                    se3.inverse(one.T_rig_board) @ other.T_rig_board, distance, one.weight * other.weight
                )
    return {pair: content for pair, content in found.items() if content.poses}
