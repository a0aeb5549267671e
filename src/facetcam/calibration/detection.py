"""Every sighting of every board in one photo."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam.calibration.boards import Board, BoardSet
from facetcam.calibration.chessboards import detect_chessboards
from facetcam.calibration.corners import refine
from facetcam.calibration.markers import Group, find_groups, homography, project
from facetcam.calibration.sightings import Sighting

__all__ = ["detect", "refine", "to_grey"]

Array = NDArray[np.float64]

_LEAST_CORNERS = 4  # of a sighting; fewer fix no board
_LOCAL = 4  # markers nearest to a corner that predict it
_NEIGHBOURS = 8  # corners that must agree with one more
_STRAY = 0.02  # of a square, and a pixel, from where the neighbours put a corner


def detect(image: NDArray[np.generic], boards: BoardSet, photo: int = 0) -> list[Sighting]:
    """Find the boards in a photo, each as often as it is seen, directly and in mirrors.

    Parameters
    ----------
    image : (H, W) or (H, W, 3) array
        Grey or BGR, 8 or 16 bit, as the camera gave it.
    boards : BoardSet
    photo : int
        Index to write into the sightings.

    Returns
    -------
    list of Sighting
        With views unknown; `mirrored` tells how the pattern was read.
    """
    grey = to_grey(image)
    sightings = []
    for group in find_groups(grey, boards):
        corners, predicted, square_px = predict_corners(boards.boards[group.board], group)
        pixels, accepted = refine(grey, predicted, square_px)
        accepted &= np.linalg.norm(pixels - predicted, axis=1) <= 0.25 * square_px
        accepted[accepted] = in_line(
            boards.boards[group.board].points[corners[accepted], :2], pixels[accepted], square_px[accepted]
        )
        if accepted.sum() >= _LEAST_CORNERS:
            sightings.append(
                Sighting(photo, group.board, corners[accepted], pixels[accepted], group.mirrored)
            )
    for index, board in enumerate(boards.boards):
        if board.kind == "chessboard":
            sightings += detect_chessboards(grey, board, index, photo)
    return sightings


def to_grey(image: NDArray[np.generic]) -> NDArray[np.uint8]:
    """8-bit grey of a grey or BGR image of 8 or 16 bit; 16 bit are stretched to what the image uses."""
    values = np.asarray(image)
    if values.dtype != np.uint8:
        top = max(float(np.percentile(values[::4, ::4], 99.9)), 1.0)
        values = np.clip(values * (255.0 / top), 0, 255).astype(np.uint8)
    if values.ndim == 3:
        values = cv2.cvtColor(values, cv2.COLOR_BGR2GRAY)
    return np.ascontiguousarray(values, dtype=np.uint8)


def predict_corners(board: Board, group: Group) -> tuple[NDArray[np.int64], Array, Array]:
    """Corners that touch a marker of the group: their indices, where they should be, a square's side there.

    Returns
    -------
    corners : (N,) int array
    predicted : (N, 2) array
        Pixels, by the homography of the markers nearest to each: a lens may bend the board as a whole.
    square_px : (N,) array
        The shorter of the two sides of `Board.corner_square`, in pixels.
    """
    centres = group.plane.mean(axis=1)
    points = board.points[:, :2]
    apart = np.linalg.norm(points[:, None] - centres[None], axis=2)
    corners = np.flatnonzero(apart.min(axis=1) < 0.75 * board.square)
    predicted, sides = np.empty((len(corners), 2)), np.empty(len(corners))
    for row, corner in enumerate(corners):
        nearest = np.argsort(apart[corner])[:_LOCAL]
        H = homography(group.plane[nearest].reshape(-1, 2), group.quads[nearest].reshape(-1, 2))
        around = points[corner] + 0.5 * board.square * np.array(
            [[0.0, 0.0], [-1.0, 0.0], [1.0, 0.0], [0.0, -1.0], [0.0, 1.0]]
        )
        at = project(H, around) if H is not None else np.full((5, 2), -1e9)
        predicted[row] = at[0]
        sides[row] = min(np.linalg.norm(at[2] - at[1]), np.linalg.norm(at[4] - at[3]))
    return corners, predicted, sides * (board.corner_square / board.square)


def in_line(plane: Array, pixels: Array, square_px: Array) -> NDArray[np.bool_]:
    """Tell which corners stand where a homography of the corners next to them puts them.

    What a seam between views or something in front makes of a corner may look like one, elsewhere.
    """
    good = np.ones(len(plane), dtype=bool)
    if len(plane) <= _NEIGHBOURS:
        return good
    apart = np.linalg.norm(plane[:, None] - plane[None], axis=2)
    off = np.zeros(len(plane))
    for _ in range(2):  # a stray corner spoils what its neighbours say; without it they are asked again
        for row in range(len(plane)):
            order = np.argsort(np.where(good, apart[row], np.inf))
            near = order[order != row][:_NEIGHBOURS]
            H = homography(plane[near], pixels[near])
            off[row] = np.inf if H is None else np.linalg.norm(project(H, plane[row : row + 1]) - pixels[row])
        limit = 1.0 + _STRAY * square_px
        good = off <= (limit if not good.all() else np.maximum(limit, 0.5 * off.max()))
    return good
