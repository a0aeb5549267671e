"""The lens by Zhang's calibration, and where every sighting of a board seems to be before it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam.calibration.boards import Board, BoardSet
from facetcam.calibration.chessboards import placements
from facetcam.calibration.plane_pose import plane_pose
from facetcam.calibration.sightings import Sighting
from facetcam.errors import FacetcamError
from facetcam.rig import Camera
from facetcam.rig.camera import BROWN_CONRADY

Array = NDArray[np.float64]

LEAST_CORNERS = 12  # of a sighting that takes part in the first lens
_SYMMETRIES = 4  # of a board at most


@dataclass(frozen=True, eq=False)
class Seen:
    """A sighting, where its corners seem to be in the camera frame, and its readings behind even and odd
    chains."""

    sighting: Sighting
    points: Array
    square_px: float
    ways: tuple[list[Sighting], list[Sighting]]

    @property
    def placed(self) -> bool:
        """False for a part of a board that may lie in many places on it."""
        return max(map(len, self.ways)) <= _SYMMETRIES


def lens_and_places(
    boards: BoardSet, sightings: Sequence[Sighting], size: tuple[int, int]
) -> tuple[Camera, list[Seen]]:
    """The lens by Zhang's calibration, and the corners of every sighting in the camera frame."""
    whole = [s for s in sightings if len(s) >= LEAST_CORNERS]
    if len(whole) < 3:
        raise FacetcamError(
            f"calibration: {len(whole)} sightings with {LEAST_CORNERS} corners or more in all photos;"
            " the lens takes at least 3 with the board at different tilts"
        )
    flat = [boards.boards[s.board].points[s.corners].astype(np.float32) for s in whole]
    pixels = [s.pixels.astype(np.float32).reshape(-1, 1, 2) for s in whole]
    flags = cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_ASPECT_RATIO
    start = np.array(
        [[1.2 * max(size), 0, (size[0] - 1) / 2], [0, 1.2 * max(size), (size[1] - 1) / 2], [0, 0, 1]]
    )
    if len(whole) < 8:
        flags |= cv2.CALIB_FIX_PRINCIPAL_POINT | cv2.CALIB_FIX_K2
    _, K, d, _, _ = cv2.calibrateCamera(
        flat, pixels, size, start, np.zeros(5), flags=flags | cv2.CALIB_USE_INTRINSIC_GUESS
    )
    fx, fy, cx, cy = (float(v) for v in (K[0, 0], K[1, 1], K[0, 2], K[1, 2]))
    if not (0.2 * max(size) < fx < 20 * max(size)):
        raise FacetcamError(
            f"calibration: the sightings give a focal length of {fx:.0f} px, which cannot be; tilt the board"
            " more from photo to photo, and check its squares in boards.yaml"
        )
    camera = Camera(BROWN_CONRADY, *size, fx, fy, cx, cy, tuple(float(v) for v in d.ravel()[:5]))
    return camera, [_placed(camera, boards.boards[s.board], s) for s in whole]


def _placed(camera: Camera, board: Board, sighting: Sighting) -> Seen:
    rays = camera.ray(sighting.pixels)
    flat, image = board.points[sighting.corners], rays[:, :2] / rays[:, 2:]
    T = plane_pose(flat, image)
    if T is None:
        raise FacetcamError(
            f"calibration: no place explains board '{board.name}'; check its squares in boards.yaml"
        )
    turn, shift = cv2.solvePnPRefineLM(
        flat, image, np.eye(3), None, cv2.Rodrigues(T[:3, :3])[0], T[:3, 3].reshape(3, 1)
    )
    points = flat @ cv2.Rodrigues(turn)[0].T + shift.ravel()
    size = (
        np.ptp(sighting.pixels, axis=0) / np.maximum(np.ptp(flat[:, :2], axis=0), board.square) * board.square
    )
    ways = (_ways(sighting, board, False), _ways(sighting, board, True))
    return Seen(sighting, points, float(np.min(size)), ways)


def _ways(sighting: Sighting, board: Board, mirrored: bool) -> list[Sighting]:
    """Readings of a sighting in a view of one parity."""
    if board.kind != "chessboard":
        return [sighting] if sighting.mirrored == mirrored else []
    return placements(sighting, board, mirrored)
