"""Which view each sighting was seen in, and where boards and rig roughly stood, by consistency."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from facetcam.calibration.boards import BoardSet
from facetcam.calibration.sightings import Sighting
from facetcam.calibration.start import is_mirrored
from facetcam.geometry import se3
from facetcam.rig import NO_VIEW, Rig

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_ASTRAY = 0.13  # radians by which mirrors off the drawing may displace a view on the sensor
_TURN = np.radians(30.0)  # by which poses through different views may disagree before the solve
_SHIFT = 0.4  # the same for their distance, as a share of it
_SURE = 6.0  # growth of the odds of a view with the depth inside it
_ROUNDS = 3  # of placing rigs by boards, and boards by rigs
_HEAVIEST = 30  # corners; more make a sighting no surer
_STEP = 4  # pixels between samples of the map of views
_MOST = 200  # relations of two boards that are compared


@dataclass(frozen=True, eq=False)
class Candidate:
    """A view in which a sighting may have been seen.

    `depth` says how far inside the view, as drawn, it lies; negative outside. `T_rig_board` is the
    pose of its board if it was seen there.
    """

    view: int
    depth: float
    T_rig_board: Array

    @property
    def weight(self) -> float:
        """How likely the place on the sensor makes it, against other views."""
        return float(1.0 / (1.0 + np.exp(-_SURE * self.depth)))


@dataclass(frozen=True, eq=False)
class Assignment:
    """Views and rough poses.

    Attributes
    ----------
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
        _candidates(rig, views, depths, s, is_mirrored(s, boards), T)
        for s, T in zip(sightings, T_image_board)
    ]
    if boards.fixed:
        T_station_board, part = _constellation(len(boards.boards), sightings, candidates)
        board = np.array([s.board for s in sightings], dtype=np.int64)
        keys: list[tuple[int, int | None]] = [(s.photo, None) for s in sightings]
    else:
        T_station_board, board = np.eye(4)[None], np.zeros(len(sightings), dtype=np.int64)
        keys, part = [(s.photo, s.board) for s in sightings], np.zeros(1, dtype=np.int64)
    stations = tuple(sorted(set(keys), key=lambda key: (key[0], -1 if key[1] is None else key[1])))
    station = np.array([stations.index(key) for key in keys], dtype=np.int64)
    corners = [min(len(s), _HEAVIEST) for s in sightings]
    for _ in range(_ROUNDS):
        poses, view = _place_rigs(candidates, T_station_board, board, station, corners)
        if boards.fixed:
            T_station_board = _place_boards(candidates, T_station_board, board, poses[station], part)
    return Assignment(view, board, station, T_station_board, poses, part, stations)


def _place_rigs(
    candidates: Sequence[list[Candidate]],
    T_station_board: Array,
    board: Index,
    station: Index,
    corners: Sequence[int],
) -> tuple[Array, Index]:
    """Pose of every station, and the view of every sighting, the boards given."""
    view = np.full(len(candidates), NO_VIEW, dtype=np.int64)
    poses = np.tile(np.eye(4), (int(station.max()) + 1, 1, 1))
    for p in range(len(poses)):
        rows = np.flatnonzero(station == p).tolist()
        poses[p], view[rows] = _station(
            [candidates[i] for i in rows],
            [T_station_board[board[i]] for i in rows],
            [corners[i] for i in rows],
        )
    return poses, view


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
        votes = _Votes()
        for i in np.flatnonzero(board == b).tolist():
            for c in candidates[i]:
                votes.add(
                    se3.inverse(T_rig_station[i]) @ c.T_rig_board, 2 * _distance(c.T_rig_board), c.weight
                )
        if votes.poses:
            out[b] = votes.winner()[0]
    return out


class ViewDepths:
    """How far inside each view pixels lie.

    Parameters
    ----------
    rig : Rig
    views : sequence of str
    """

    def __init__(self, rig: Rig, views: Sequence[str]) -> None:
        labels = rig.labels()[::_STEP, ::_STEP]
        # Unbounded mirrors without regions share all their pixels: where views end is then not known.
        self.bounded = all(m.polygon is not None for m in rig.mirrors.values())
        self._maps = []
        for view in views:
            own = np.pad((labels == rig.view_names.index(view)).astype(np.uint8), 1)
            inside, outside = (cv2.distanceTransform(m, cv2.DIST_L2, 5)[1:-1, 1:-1] for m in (own, 1 - own))
            far = float(max(labels.shape))  # where a view has no pixel at all
            self._maps.append(_STEP * np.where(own[1:-1, 1:-1] > 0, inside, -np.minimum(outside, far)))

    def at(self, view: int, pixels: Array) -> Array:
        """Pixels (N,) from the edge of the view, positive inside, of raw-frame pixels (N, 2)."""
        limits = np.array(self._maps[view].shape[::-1]) - 1
        u, v = np.clip(np.rint(pixels / _STEP), 0, limits).astype(np.int64).T
        return np.asarray(self._maps[view][v, u], dtype=np.float64)


def _candidates(
    rig: Rig, views: Sequence[str], depths: ViewDepths, sighting: Sighting, mirrored: bool, T: Array
) -> list[Candidate]:
    """Views of the right handedness near which the sighting lies, likeliest first."""
    if sighting.view is not None:
        wanted = list(views).index(sighting.view) if sighting.view in views else None
        fits = wanted is not None and rig.is_flipped(sighting.view) == mirrored
        return (
            [Candidate(wanted, np.inf, rig.T_rig_image(sighting.view) @ T)]
            if fits and wanted is not None
            else []
        )
    reach = _ASTRAY * max(rig.camera.fx, rig.camera.fy)
    found = []
    for index, name in enumerate(views):
        depth = float(np.median(depths.at(index, sighting.pixels)))
        if rig.is_flipped(name) == mirrored and depth > -reach:
            found.append(Candidate(index, min(depth / reach, 1.0), rig.T_rig_image(name) @ T))
    return sorted(found, key=lambda c: -c.depth)


def _constellation(
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
) -> dict[tuple[int, int], _Votes]:
    """Where photos say that the second of two boards stands from the first, with distances to scale by."""
    found: dict[tuple[int, int], _Votes] = {}
    for i, j in combinations(range(len(sightings)), 2):
        if sightings[i].photo != sightings[j].photo or sightings[i].board == sightings[j].board:
            continue
        a, b = (i, j) if sightings[i].board < sightings[j].board else (j, i)
        votes = found.setdefault((sightings[a].board, sightings[b].board), _Votes())
        for one in candidates[a]:
            for other in candidates[b]:
                distance = _distance(one.T_rig_board) + _distance(other.T_rig_board)
                votes.add(
                    se3.inverse(one.T_rig_board) @ other.T_rig_board, distance, one.weight * other.weight
                )
    return {pair: content for pair, content in found.items() if content.poses}


class _Votes:
    """Poses that sightings speak for, each with the distance it was seen over and a weight."""

    def __init__(self) -> None:
        self.poses: list[Array] = []
        self._distances: list[float] = []
        self._weights: list[float] = []

    def add(self, pose: Array, distance: float, weight: float) -> None:
        """Speak for a pose."""
        self.poses.append(pose)
        self._distances.append(distance)
        self._weights.append(weight)

    def winner(self) -> tuple[Array, float]:
        """The pose that most speak for, and their weight."""
        chosen = np.linspace(0, len(self.poses) - 1, min(len(self.poses), _MOST)).astype(np.int64)
        T, distance, weight = (np.array(x)[chosen] for x in (self.poses, self._distances, self._weights))
        agree = np.array([_agree(T, one, 0.5 * (distance + d)) for one, d in zip(T, distance)])
        support = agree @ weight
        best = int(np.argmax(support))
        return _mean(T[agree[best]], weight[agree[best]]), float(support[best])


def _station(
    candidates: list[list[Candidate]], T_station_board: list[Array], corners: list[int]
) -> tuple[Array, list[int]]:
    """The rig pose on which most sightings of a photo agree, and the view of each."""
    poses = [[c.T_rig_board @ se3.inverse(T) for c in found] for found, T in zip(candidates, T_station_board)]
    best: tuple[float, Array, list[int]] = (-np.inf, np.eye(4), [NO_VIEW] * len(candidates))
    for trial in (pose for group in poses for pose in group):
        score, views, members = 0.0, [], []
        for found, group, weight in zip(candidates, poses, corners):
            fitting = [k for k in range(len(group)) if _fits(group[k], trial, found[k].T_rig_board)]
            k = min(fitting, key=lambda k: _angle(group[k], trial), default=None)
            views.append(NO_VIEW if k is None else found[k].view)
            if k is not None:
                score += weight * found[k].weight
                members.append((group[k], weight))
        if score > best[0]:
            poses_in, weights = np.array([m[0] for m in members]), np.array([m[1] for m in members])
            best = (score, _mean(poses_in, weights), views)
    return best[1], best[2]


def _fits(pose: Array, trial: Array, T_rig_board: Array) -> bool:
    return bool(_agree(pose[None], trial, np.array([2.0 * _distance(T_rig_board)]))[0])


def _agree(T: Array, one: Array, scale: Array) -> NDArray[np.bool_]:
    cosine = 0.5 * (np.einsum("nij,ij->n", T[:, :3, :3], one[:3, :3]) - 1.0)
    shift = np.linalg.norm(T[:, :3, 3] - one[:3, 3], axis=1)
    near: NDArray[np.bool_] = (cosine > np.cos(_TURN)) & (shift < _SHIFT * scale)
    return near


def _angle(a: Array, b: Array) -> float:
    return float(-np.einsum("ij,ij->", a[:3, :3], b[:3, :3]))


def _mean(T: Array, weights: Array | None = None) -> Array:
    R = Rotation.from_matrix(T[:, :3, :3]).mean(weights).as_matrix()
    return se3.from_rotation_translation(R, np.average(T[:, :3, 3], axis=0, weights=weights))


def _distance(T: Array) -> float:
    return float(np.linalg.norm(T[:3, 3]))
