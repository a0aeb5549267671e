"""Markers in a photo and in its mirror image, and groups of them that one board explains."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam.calibration.boards import MARKED, Board, BoardSet

Array = NDArray[np.float64]

_LEAST_PERIMETER = 36.0  # pixels round the smallest marker that is looked for
_REACH = 2.9  # squares to markers that must agree with each other: the next ones, and those behind these
_TOLERANCE = 0.16  # of a marker's side, between where a group puts a marker and where it is
_NEAREST = 4  # markers of a group that predict the next one: few, so that a lens may bend the board
_LEAST_MARKERS = 2  # a single one proves nothing: a mirrored marker may read as another


@dataclass(frozen=True, eq=False)
class Markers:
    """Markers read in one photo with one parity: ids (M,) and corners (M, 4, 2) in raw-frame pixels."""

    mirrored: bool
    ids: NDArray[np.int64]
    quads: Array


@dataclass(frozen=True, eq=False)
class Group:
    """Markers that one sighting of a board explains.

    `rows` (M,) index `Board.ids`, `quads` (M, 4, 2) are their corners in raw-frame pixels and `plane`
    (M, 4, 2) on the board in metres.
    """

    board: int
    mirrored: bool
    rows: NDArray[np.int64]
    quads: Array
    plane: Array

    def __len__(self) -> int:
        return len(self.rows)


def find_groups(image: NDArray[np.uint8], boards: BoardSet) -> list[Group]:
    """Every sighting of every board with markers, as groups of markers, the largest first.

    A mirror image is read on the flipped photo. Markers that are read wrongly, as a mirrored DICT_4X4_50
    sometimes is, fit neither a board's plan nor their neighbours, or lie where a larger group lies.
    """
    groups = []
    for dictionary, border in sorted(
        {(b.dictionary or "", b.border) for b in boards.boards if b.kind in MARKED}
    ):
        own = [b.ids for b in boards.boards if (b.dictionary, b.border) == (dictionary, border)]
        ids = np.unique(np.concatenate(own))
        for mirrored in (False, True):
            found = read_markers(image, _of(boards, dictionary, border), mirrored, ids)
            for index, board in enumerate(boards.boards):
                if (board.dictionary, board.border) == (dictionary, border):
                    groups += list(_groups_of_board(found, index, board))
    groups.sort(key=len, reverse=True)
    kept: list[Group] = []
    for group in groups:
        if not any(_overlap(group, other) for other in kept):
            kept.append(group)
    return kept


def fitting_pairs(found: Markers, board: Board) -> int:
    """How many pairs of neighbouring markers stand to each other as the board's plan says."""
    mine = (found.ids >= board.ids.start) & (found.ids < board.ids.stop)
    plan = board.marker_corners[found.ids[mine] - board.ids.start, :, :2]
    quads = found.quads[mine]
    flat = np.roll(plan, _turns(board, plan, quads), axis=1)
    return int(np.count_nonzero(_agreements(flat, quads, board))) // 2


def read_markers(
    image: NDArray[np.uint8], board: Board, mirrored: bool, wanted: NDArray[np.int64] | None = None
) -> Markers:
    """Markers of a board's dictionary, in the photo or in its mirror image.

    Only those of the ids `wanted`, if given: most of the time goes into the comparison with all codes.
    """
    height, width = image.shape
    settings = cv2.aruco.DetectorParameters()
    settings.minMarkerPerimeterRate = min(0.5, _LEAST_PERIMETER / max(width, height))
    settings.markerBorderBits = board.border
    codes = board.markers_of_dictionary
    if wanted is not None:
        codes = cv2.aruco.Dictionary(codes.bytesList[wanted], codes.markerSize, codes.maxCorrectionBits)
    detector = cv2.aruco.ArucoDetector(codes, settings)
    corners, ids, _ = detector.detectMarkers(cv2.flip(image, 1) if mirrored else image)
    if ids is None or not len(ids):
        return Markers(mirrored, np.empty(0, dtype=np.int64), np.empty((0, 4, 2)))
    quads = np.array(corners, dtype=np.float64).reshape(-1, 4, 2)
    if mirrored:
        quads[..., 0] = width - 1 - quads[..., 0]
    read = np.asarray(ids, dtype=np.int64).ravel()
    return Markers(mirrored, read if wanted is None else wanted[read], quads)


def _of(boards: BoardSet, dictionary: str, border: int) -> Board:
    return next(b for b in boards.boards if (b.dictionary, b.border) == (dictionary, border))


def _groups_of_board(found: Markers, index: int, board: Board) -> Iterator[Group]:
    """Grow groups from marker to neighbouring marker; what is left begins another one."""
    mine = (found.ids >= board.ids.start) & (found.ids < board.ids.stop)
    rows, quads = found.ids[mine] - board.ids.start, found.quads[mine]
    plan = board.marker_corners[:, :, :2]
    flat = np.roll(plan[rows], _turns(board, plan[rows], quads), axis=1)
    least = min(_LEAST_MARKERS, len(board.ids))
    free = np.ones(len(rows), dtype=bool)
    agree = _agreements(flat, quads, board)
    while free.any():
        votes = (agree & free[:, None] & free[None, :]).sum(axis=1)
        seed = int(np.argmax(np.where(free, votes, -1)))
        members = _grown(seed, rows, flat, quads, free, board)
        free[members] = False
        if len(members) >= least:
            yield Group(index, found.mirrored, rows[members], quads[members], flat[members])


def _turns(board: Board, plan: Array, quads: Array) -> int:
    """Quarter turns by which the code stands on the board: tags of Kalibr's are printed upside down."""
    if board.kind != "aprilgrid" or len(plan) < 2:
        return 0
    scores = [int(_agreements(np.roll(plan, turn, axis=1), quads, board).sum()) for turn in range(4)]
    return int(np.argmax(scores))


def _agreements(flat: Array, quads: Array, board: Board) -> NDArray[np.bool_]:
    """Tell which pairs (M, M) of markers near each other on the board one homography explains."""
    count = len(flat)
    agree = np.zeros((count, count), dtype=bool)
    centres = flat.mean(axis=1)
    apart = np.linalg.norm(centres[:, None] - centres[None], axis=2)
    near = (apart > 0.5 * board.square) & (apart < _REACH * board.square)
    i, j = np.nonzero(np.triu(near))
    pairs = np.stack([i, j], axis=1)
    agree[i, j] = agree[j, i] = _misfits(flat[pairs], quads[pairs]) <= _TOLERANCE
    return agree


def _grown(
    seed: int, rows: NDArray[np.int64], flat: Array, quads: Array, free: NDArray[np.bool_], board: Board
) -> list[int]:
    """Indices of the markers that join `seed` one by one, the nearest first, where the group has them."""
    members = [seed]
    centres = flat.mean(axis=1)
    open_ = free.copy()
    open_[seed] = False
    while open_.any():
        apart = np.linalg.norm(centres[:, None] - centres[members][None], axis=2)
        apart[np.isin(rows, rows[members])] = np.inf  # each marker once in a group
        nearest = np.where(open_, apart.min(axis=1), np.inf)
        near = np.flatnonzero(nearest < _REACH * board.square)
        joined = False
        for candidate in near[np.argsort(nearest[near])]:
            if rows[candidate] in rows[members]:
                continue
            order = np.argsort(np.linalg.norm(centres[members] - centres[candidate], axis=1))[:_NEAREST]
            known = [members[k] for k in order]
            # The candidate takes part in the fit: four corners of one marker alone would predict badly.
            both = [*known, int(candidate)]
            if _misfits(flat[None, both], quads[None, both])[0] <= _TOLERANCE:
                members.append(int(candidate))
                open_[candidate] = False
                joined = True
        if not joined:
            break
    return members


def _misfits(plane: Array, quads: Array) -> Array:
    """Largest distance (P,), in marker sides, of quads (P, M, 4, 2) from where one homography puts them."""
    count, markers = plane.shape[:2]
    H = homographies(plane.reshape(count, 4 * markers, 2), quads.reshape(count, 4 * markers, 2))
    sides = np.linalg.norm(quads - np.roll(quads, 1, axis=2), axis=3).mean(axis=2)
    at = _projected(H, plane.reshape(count, 4 * markers, 2)).reshape(count, markers, 4, 2)
    off = np.linalg.norm(at - quads, axis=3)
    misfits: Array = (off / (sides[:, :, None] + 4.0)).max(axis=(1, 2))  # and 0.6 pixels for tiny markers
    return misfits


def homography(plane: Array, pixels: Array) -> Array | None:
    """Homography from board (N, 2) to pixels (N, 2) by linear least squares; None where there is none."""
    H = homographies(plane[None], pixels[None])[0]
    return H if np.all(np.isfinite(H)) else None


def homographies(plane: Array, pixels: Array) -> Array:
    """Homographies (P, 3, 3) of P sets of N > 3 points each; NaN where the points fix none."""
    to_unit, (x, y) = _normalised(plane)
    from_unit, (u, v) = _normalised(pixels)
    one, none = np.ones_like(x), np.zeros_like(x)
    rows_u = np.stack([x, y, one, none, none, none, -u * x, -u * y], axis=2)
    rows_v = np.stack([none, none, none, x, y, one, -v * x, -v * y], axis=2)
    A, b = np.concatenate([rows_u, rows_v], axis=1), np.concatenate([u, v], axis=1)
    # The middle of the points is in sight, so that the last element is not zero there.
    normal = np.swapaxes(A, 1, 2) @ A
    fixed = np.linalg.cond(normal) < 1e13
    normal[~fixed] = np.eye(8)
    h = np.linalg.solve(normal, np.swapaxes(A, 1, 2) @ b[..., None])[..., 0]
    H = np.concatenate([h, np.ones((len(h), 1))], axis=1).reshape(-1, 3, 3)
    H = np.linalg.inv(from_unit) @ H @ to_unit
    H[~fixed] = np.nan
    return np.asarray(H, dtype=np.float64)


def _normalised(points: Array) -> tuple[Array, Array]:
    """Maps (P, 3, 3) that bring points (P, N, 2) to the middle and to size one, and the points (2, P, N)."""
    middle = points.mean(axis=1)
    scale = 1.0 / np.maximum(np.abs(points - middle[:, None]).mean(axis=(1, 2)), 1e-12)
    T = np.zeros((len(points), 3, 3))
    T[:, 0, 0] = T[:, 1, 1] = scale
    T[:, :2, 2] = -middle * scale[:, None]
    T[:, 2, 2] = 1.0
    moved = (points - middle[:, None]) * scale[:, None, None]
    return T, np.moveaxis(moved, 2, 0)


def project(H: Array, points: Array) -> Array:
    """Points (N, 2) through a homography; points beyond its horizon go far away."""
    mapped: Array = _projected(H[None], points[None])[0]
    return mapped


def _projected(H: Array, points: Array) -> Array:
    """Points (P, N, 2) through homographies (P, 3, 3)."""
    x = points @ np.swapaxes(H[:, :, :2], 1, 2) + H[:, None, :, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        mapped: Array = x[..., :2] / x[..., 2:]
    return np.asarray(np.where(np.isfinite(mapped), mapped, 1e9))


def _overlap(group: Group, other: Group) -> bool:
    """Tell whether a marker of one stands on a marker of the other."""
    one, two = group.quads.mean(axis=1), other.quads.mean(axis=1)
    side = np.linalg.norm(group.quads[:, 0] - group.quads[:, 1], axis=1)
    apart = np.linalg.norm(one[:, None] - two[None], axis=2)
    return bool((apart < 0.3 * side[:, None]).any())
