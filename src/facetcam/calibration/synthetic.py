"""Sightings that a known rig would make: to plan photos, and to judge the solver against truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from facetcam.calibration.boards import Board, BoardSet
from facetcam.calibration.sightings import Sighting
from facetcam.geometry import se3
from facetcam.rig import Rig

Array = NDArray[np.float64]


def projected_sightings(
    rig: Rig,
    boards: BoardSet,
    T_rig_boards: Sequence[Mapping[int, Array]],
    noise: float = 0.0,
    seed: int = 0,
    least: int = 4,
) -> list[Sighting]:
    """Sight all corners that a rig shows, with Gaussian noise.

    Parameters
    ----------
    T_rig_boards : sequence, one a photo, of mapping of board to (4, 4) array
        Where the boards stand in the frame of the rig.
    noise : float
        Standard deviation of a coordinate, pixels.
    least : int
        Sightings of fewer corners are left out.
    """
    random = np.random.default_rng(seed)
    out = []
    for photo, placed in enumerate(T_rig_boards):
        for index, T_rig_board in placed.items():
            for view in rig.views:
                corners, pixels = seen_corners(rig, view, boards.boards[index], T_rig_board)
                if len(corners) >= least:
                    noisy = pixels + noise * random.standard_normal(pixels.shape)
                    out.append(Sighting(photo, index, corners, noisy, rig.is_flipped(view)))
    return out


def seen_corners(rig: Rig, view: str, board: Board, T_rig_board: Array) -> tuple[NDArray[np.int64], Array]:
    """Corners of a board that one view shows, and their pixels; none of a board that turns its back."""
    centre = se3.transform(se3.inverse(T_rig_board), rig.T_rig_image(view)[None, :3, 3])[0]
    pixels, visible = rig.project(view, se3.transform(T_rig_board, board.points))
    corners = np.flatnonzero(visible & (centre[2] < 0))
    return corners, pixels[corners]
