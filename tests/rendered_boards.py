"""Photos of boards through the true mirrors of any rig, ray-traced, with light, blur and noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam.calibration import Board, BoardSet
from facetcam.rig import Rig
from facetcam.simulation.exposures import Exposures
from facetcam.simulation.mesh_renderer import MeshRenderer
from facetcam.simulation.meshes import Material, Mesh, joined, quad
from facetcam.simulation.sensor import AutoExposure, Sensor
from facetcam.simulation.settings import CameraSettings
from facetcam.viz.board_pages import black_shapes

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

WHITE, BLACK = 225, 35
SQUARE_TEXELS = 80
ROOM = 4.0  # metres from the rig to the walls
SETTINGS = CameraSettings()


def write_board_photos(
    folder: Path, rig: Rig, boards: BoardSet, T_rig_boards: Sequence[Mapping[int, Array]], seed: int = 0
) -> Path:
    """Write `000.png`, ..., one for each placing of the boards in the frame of the rig."""
    folder.mkdir(parents=True, exist_ok=True)
    random = np.random.default_rng([seed, 7])
    exposures: Exposures | None = None
    for index, placed in enumerate(T_rig_boards):
        renderer = _scene(boards, placed)
        exposures = exposures or Exposures(rig, renderer, SETTINGS)
        exposures.renderer = renderer  # the rays, which take longest, stay the same
        radiance = exposures.radiance(lambda time: np.eye(4), 0.0)
        picture = Sensor().develop(radiance, AutoExposure().follow(radiance, 0.0), random)
        cv2.imwrite(str(folder / f"{index:03d}.png"), cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY))
    return folder


def _scene(boards: BoardSet, placed: Mapping[int, Array]) -> MeshRenderer:
    """Boards in a room with spotted walls, lit from everywhere."""
    panels = [_panel(boards.boards[b], T) for b, T in placed.items()]
    return MeshRenderer(joined([*panels, *_walls()]), ambient=(1.0, 1.0, 1.0))


def _panel(board: Board, T: Array) -> Mesh:
    """The board on a white sheet with a rim of half a square."""
    picture = drawing(board)
    metres = board.square / SQUARE_TEXELS
    rim, size = metres * (SQUARE_TEXELS // 2), metres * np.array(picture.shape[1::-1])
    corner = T[:3, 3] - rim * (T[:3, 0] + T[:3, 1])
    return quad(corner, size[0] * T[:3, 0], size[1] * T[:3, 1], Material(picture))


@cache
def drawing(board: Board) -> Image:
    """The board, RGB, `SQUARE_TEXELS` a square, with a rim; edges between texels are mixed."""
    scale, rim = SQUARE_TEXELS / board.square, SQUARE_TEXELS // 2
    width, height = (int(np.ceil(scale * side - 1e-6)) + 2 * rim for side in board.size)
    dark = np.zeros((height, width))
    for x, y, w, h in np.concatenate(black_shapes(board)) * scale + (rim, rim, 0, 0):
        dark += np.outer(_covered(y, y + h, height), _covered(x, x + w, width))
    grey = np.rint(WHITE + (BLACK - WHITE) * np.clip(dark, 0, 1)).astype(np.uint8)
    return np.repeat(grey[..., None], 3, axis=2)


def _covered(start: float, end: float, count: int) -> Array:
    """Share of each of so many texels between two places."""
    texels = np.arange(count)
    return np.clip(np.minimum(end, texels + 1) - np.maximum(start, texels), 0.0, 1.0)


@cache
def _walls() -> tuple[Mesh, ...]:
    """Six walls with soft spots: nothing that looks like a board, nothing plain either."""
    random = np.random.default_rng(5)
    fine, coarse = (cv2.resize(random.uniform(0, 1, (n, n)), (512, 512)) for n in (90, 14))
    spots = np.rint(70 + 110 * (0.4 * fine + 0.6 * coarse)).astype(np.uint8)
    material = Material(np.repeat(spots[..., None], 3, axis=2))
    walls = []
    for axis in range(3):
        for side in (-1.0, 1.0):
            corner = np.full(3, -ROOM)
            corner[axis] = side * ROOM
            right, down = (2 * ROOM * np.eye(3)[(axis + k) % 3] for k in (1, 2))
            walls.append(quad(corner, right, down, material))
    return tuple(walls)
