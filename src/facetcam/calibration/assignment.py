"""Which view each sighting was seen in, and where boards and rig roughly stood, by consistency."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from facetcam.calibration.boards import BoardSet
from facetcam.calibration.candidates import Candidate, ViewDepths, candidates_of
from facetcam.calibration.constellation import constellation
from facetcam.calibration.readings import posed_readings
from facetcam.calibration.sightings import Sighting
from facetcam.calibration.votes import Votes, agree, distance_of, mean, turned_apart
from facetcam.geometry import se3
from facetcam.rig import NO_VIEW, Rig

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_ROUNDS = 3  # of placing rigs by boards, and boards by rigs
_HEAVIEST = 30  # corners; more make a sighting no surer


@dataclass(frozen=True, eq=False)
class Assignment:
    """Views and rough poses.

    Attributes
    ----------
    sightings : tuple of Sighting
        Their corners named as the view and the rest ask for.
    view : (S,) int array
        NO_VIEW where no view is consistent with the rest.
    board, station : (S,) int arrays
        Indices into the poses below.
    T_station_board : (B, 4, 4) array
    T_rig_station : (P, 4, 4) array
    part : (B,) int array
        For each board the first of the set that was seen together with it; it carries the frame of the set.
    stations : tuple of (photo, board or None)
        None where the station serves all boards of the photo.
    """

    sightings: tuple[Sighting, ...]
    view: Index
    board: Index
    station: Index
    T_station_board: Array
    T_rig_station: Array
    part: Index
    stations: tuple[tuple[int, int | None], ...]


def assign(
    rig: Rig, views: Sequence[str], boards: BoardSet, sightings: Sequence[Sighting], T_image_board: Array
) -> Assignment:
    """Assign sightings to views.

    Parameters
    ----------
    rig : Rig
        As drawn; each mirror good to a few degrees.
    views : sequence of str
        Names in the order of the indices.
    T_image_board : (S, 4, 4) array
        Signed pose of each sighting's board before the image it was seen in.
    """
    depths = ViewDepths(rig, views)
    candidates = [
        candidates_of(rig, views, depths, posed_readings(s, boards, T))
        for s, T in zip(sightings, T_image_board)
    ]
    if boards.fixed:
        T_station_board, part = constellation(len(boards.boards), sightings, candidates)
        board = np.array([s.board for s in sightings], dtype=np.int64)
        keys: list[tuple[int, int | None]] = [(s.photo, None) for s in sightings]
    else:
        T_station_board, board = np.eye(4)[None], np.zeros(len(sightings), dtype=np.int64)
        keys, part = [(s.photo, s.board) for s in sightings], np.zeros(1, dtype=np.int64)
    stations = tuple(sorted(set(keys), key=lambda key: (key[0], -1 if key[1] is None else key[1])))
    station = np.array([stations.index(key) for key in keys], dtype=np.int64)
    corners = [min(len(s), _HEAVIEST) for s in sightings]
    for _ in range(_ROUNDS):
        poses, chosen = _place_rigs(candidates, T_station_board, board, station, corners)
        if boards.fixed:
            T_station_board = _place_boards(candidates, T_station_board, board, poses[station], part)
    view = np.array([NO_VIEW if c is None else c.view for c in chosen], dtype=np.int64)
    read = tuple(s if c is None else c.sighting for s, c in zip(sightings, chosen))
    return Assignment(read, view, board, station, T_station_board, poses, part, stations)


def _place_rigs(
    candidates: Sequence[list[Candidate]],
    T_station_board: Array,
    board: Index,
    station: Index,
    corners: Sequence[int],
) -> tuple[Array, list[Candidate | None]]:
    """Pose of every station, and the view and reading of every sighting, the boards given."""
    chosen: list[Candidate | None] = [None] * len(candidates)
    poses = np.tile(np.eye(4), (int(station.max()) + 1, 1, 1))
    for p in range(len(poses)):
        rows = np.flatnonzero(station == p).tolist()
        poses[p], found = _station(
            [candidates[i] for i in rows],
            [T_station_board[board[i]] for i in rows],
            [corners[i] for i in rows],
        )
        for row, candidate in zip(rows, found):
            chosen[row] = candidate
    return poses, chosen


def _place_boards(
    candidates: Sequence[list[Candidate]],
    T_station_board: Array,
    board: Index,
    T_rig_station: Array,
    part: Index,
) -> Array:
    """Pose of every board, the rig poses of the sightings given; the first of each set stays."""
    out = T_station_board.copy()
    for b in set(np.unique(board).tolist()) - set(part.tolist()):
        votes = Votes()
        for i in np.flatnonzero(board == b).tolist():
            for c in candidates[i]:
                votes.add(
                    se3.inverse(T_rig_station[i]) @ c.T_rig_board, 2 * distance_of(c.T_rig_board), c.weight
                )
        if votes.poses:
            out[b] = votes.winner()[0]
    return out


def _station(
    candidates: list[list[Candidate]], T_station_board: list[Array], corners: list[int]
) -> tuple[Array, list[Candidate | None]]:
    """The rig pose on which most sightings of a photo agree, and how each is then seen."""
    poses = [[c.T_rig_board @ se3.inverse(T) for c in found] for found, T in zip(candidates, T_station_board)]
    best: tuple[float, Array, list[Candidate | None]] = (-np.inf, np.eye(4), [None] * len(candidates))
    for trial in (pose for group in poses for pose in group):
        score, chosen, members = 0.0, [], []
        for found, group, weight in zip(candidates, poses, corners):
            fitting = [k for k in range(len(group)) if _fits(group[k], trial, found[k].T_rig_board)]
            k = min(fitting, key=lambda k: turned_apart(group[k], trial), default=None)
            chosen.append(None if k is None else found[k])
            if k is not None:
                score += weight * found[k].weight
                members.append((group[k], weight))
        if score > best[0]:
            poses_in, weights = np.array([m[0] for m in members]), np.array([m[1] for m in members])
            best = (score, mean(poses_in, weights), chosen)
    return best[1], best[2]


def _fits(pose: Array, trial: Array, T_rig_board: Array) -> bool:
    return bool(agree(pose[None], trial, np.array([2.0 * distance_of(T_rig_board)]))[0])
