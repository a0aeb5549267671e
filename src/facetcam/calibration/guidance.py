"""The second look: where the solved rig says that corners must be."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from facetcam.calibration.bent_edges import drawn_aside
from facetcam.calibration.boards import Board, BoardSet
from facetcam.calibration.candidates import ViewDepths
from facetcam.calibration.corners import radius_of
from facetcam.calibration.fit import Fit, looks_of
from facetcam.calibration.sightings import Sighting
from facetcam.geometry import se3
from facetcam.rig import Rig

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]
# Corners where straight edges fit best, as `corners.refine` has them.
LookAgain = Callable[[int, Array, Array], tuple[Array, Mask]]

SEAM = 3.0  # pixels beside a seam in which a corner may be mixed with another view
_WINDOW = 0.14  # of a square: half the width of what is looked at round a corner
_BESIDE = 1.5  # squares from a corner that was believed: as much is in the view, whatever the drawing says
_SMALLEST = 6.0  # pixels a square; in smaller ones corners run together


@dataclass(frozen=True, eq=False)
class Expected:
    """Corners of one board that one view of one photo should show; bent edges draw them `aside`."""

    sighting: Sighting
    square_px: Array
    aside: Array
    place: int
    station: int


def looked_again(fit: Fit, boards: BoardSet, look_again: LookAgain) -> Fit:
    """Take corners from a second look at every photo, guided by the rig as it stands."""
    found: list[tuple[Expected, Array, Mask]] = []
    rig = fit.rig
    depths = ViewDepths(rig, fit.views)
    for photo in fit.photos:
        expected = expected_corners(fit, rig, depths, boards, photo)
        if not expected:
            continue
        pixels, accepted = look_again(
            photo,
            np.concatenate([e.sighting.pixels for e in expected]),
            np.concatenate([e.square_px for e in expected]),
        )
        ends = np.cumsum([len(e.sighting) for e in expected])[:-1]
        pixels = pixels - np.concatenate([e.aside for e in expected])
        found += zip(expected, np.split(pixels, ends), np.split(accepted, ends))
    found = [(e, pixels, seen) for e, pixels, seen in found if seen.any()]
    sightings = [
        replace(e.sighting, corners=e.sighting.corners[seen], pixels=pixels[seen])
        for e, pixels, seen in found
    ]
    looks = looks_of(
        sightings, boards, fit.views, [e.place for e, *_ in found], [e.station for e, *_ in found]
    )
    return replace(fit, sightings=tuple(sightings), looks=looks, kept=np.ones(len(looks.pixels), dtype=bool))


def expected_corners(fit: Fit, rig: Rig, depths: ViewDepths, boards: BoardSet, photo: int) -> list[Expected]:
    """Every corner that the rig should show in one photo, clear of seams."""
    out = []
    seen_boards = {s.board for s in fit.sightings if s.photo == photo}
    for index, board in enumerate(boards.boards):
        if not boards.fixed and index not in seen_boards:
            continue
        empty = Sighting(photo, index, np.empty(0, dtype=np.int64), np.empty((0, 2)), None)
        standing = fit.place_of(empty)
        if standing is None:
            continue
        place, station = standing
        T_rig_board = fit.state.T_rig_station[station] @ fit.state.T_station_board[place]
        for view, name in enumerate(fit.views):
            known = _believed(fit, photo, index, name)
            corners, pixels, square, aside = _in_view(rig, name, depths, view, T_rig_board, board, known)
            if len(corners):
                sighting = Sighting(photo, index, corners, pixels, rig.is_flipped(name), name)
                out.append(Expected(sighting, square, aside, place, station))
    return out


def _in_view(
    rig: Rig, name: str, depths: ViewDepths, view: int, T_rig_board: Array, board: Board, known: Index
) -> tuple[Index, Array, Array, Array]:
    """Corners that a view should show, their pixels, a square's side there, and how far they are aside."""
    T_image_board = se3.inverse(rig.T_rig_image(name)) @ T_rig_board
    if se3.inverse(T_image_board)[2, 3] >= 0:  # the board turns its back
        return np.empty(0, dtype=np.int64), np.empty((0, 2)), np.empty(0), np.empty((0, 2))
    pixels, on_sensor = rig.camera.project(se3.transform(T_image_board, board.points))
    sides = []
    for side in np.eye(3)[:2] * board.corner_square:
        beside, there = rig.camera.project(se3.transform(T_image_board, board.points + side))
        sides.append(np.where(there, np.linalg.norm(beside - pixels, axis=1), 0.0))
    square = np.minimum(*sides)
    reached = rig.project(name, se3.transform(T_rig_board, board.points))[1]
    clear = depths.at(view, pixels) > SEAM + _WINDOW * square
    if rig.views[name].region is None and not depths.bounded:
        clear[:] = False
    near = np.zeros(len(pixels), dtype=bool)
    if len(known):
        gaps = np.linalg.norm(board.points[:, None, :2] - board.points[None, known, :2], axis=2)
        near = gaps.min(axis=1) < _BESIDE * board.square
    visible = on_sensor & (square > _SMALLEST) & ((reached & clear) | near)
    corners = np.flatnonzero(visible)
    square = square[corners]

    def seen(points: Array) -> Array:
        return rig.camera.project(se3.transform(T_image_board, points))[0]

    aside = drawn_aside(seen, board.points[corners], board.corner_square, radius_of(square))
    return corners, pixels[corners], square, aside


def _believed(fit: Fit, photo: int, board: int, view: str) -> Index:
    """Corners of a board that were seen and kept in one view of a photo."""
    rows = [
        s.corners[fit.kept[a:b]]
        for s, (a, b) in zip(fit.sightings, fit.looks.bounds)
        if (s.photo, s.board, s.view) == (photo, board, view)
    ]
    return np.unique(np.concatenate([np.empty(0, dtype=np.int64), *rows]))
