"""All ways to read a sighting of a plain chessboard, whose corners carry no names."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from facetcam.calibration.boards import Board, BoardSet
from facetcam.calibration.chessboards import placements
from facetcam.calibration.sightings import Sighting
from facetcam.calibration.start import is_mirrored
from facetcam.geometry import se3

Array = NDArray[np.float64]

MOST = 4  # readings of one handedness; a part that fits the board in more places tells little of the board


@dataclass(frozen=True, eq=False)
class Reading:
    """A sighting with its corners named in one way, and the signed pose of its board before its image."""

    sighting: Sighting
    mirrored: bool
    T_image_board: Array


def readings_of(sighting: Sighting, boards: BoardSet) -> list[Sighting]:
    """The sighting, and as many others as its pattern allows; those of one handedness stand together."""
    board = boards.boards[sighting.board]
    if board.kind != "chessboard" or sighting.view is not None or sighting.mirrored is not None:
        return [sighting]
    return [*placements(sighting, board, False), *placements(sighting, board, True)]


def posed_readings(sighting: Sighting, boards: BoardSet, T_image_board: Array) -> list[Reading]:
    """Readings with their poses, from that of the sighting as it stands; none where there are too many."""
    ways = readings_of(sighting, boards)
    if len(ways) == 1:
        return [Reading(sighting, is_mirrored(sighting, boards), T_image_board)]
    if len(ways) > 2 * MOST:
        return []
    board = boards.boards[sighting.board]
    return [
        Reading(way, bool(way.mirrored), T_image_board @ se3.inverse(_renaming(board, sighting, way)))
        for way in ways
    ]


def _renaming(board: Board, old: Sighting, new: Sighting) -> Array:
    """Where points of the board go (4, 4) when its corners change names; of determinant -1 for a mirror."""
    before, after = (board.points[s.corners, :2] for s in (old, new))
    design = np.column_stack([before, np.ones(len(before))])
    affine = np.linalg.lstsq(design, after, rcond=None)[0]
    A = np.eye(4)
    A[:2, :2], A[:2, 3] = affine[:2].T, affine[2]
    return A
