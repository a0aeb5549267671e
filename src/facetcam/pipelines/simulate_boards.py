"""Calibration photos: boards that stand round the rig, and poses that see them in every view."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam.calibration import Board, BoardSet, write_boards
from facetcam.geometry import se3
from facetcam.io.outputs import atomic_write
from facetcam.rig import Rig
from facetcam.simulation.drive import Drive
from facetcam.simulation.meshes import Material, Mesh, joined, quad

Array = NDArray[np.float64]

SQUARES, SQUARE, MARKER = (11, 8), 0.06, 0.045
DICTIONARY, TEXEL = "DICT_5X5_250", 0.0005
DISTANCE = 0.7  # metres from the rig
APART = np.radians(40.0)  # views that look closer together share a board
WHITE, BLACK = 235, 40
MOST = 5  # boards that the dictionary has markers for


@dataclass(frozen=True, eq=False, slots=True)
class PlacedBoards:
    """Boards with their poses T_world_board (N, 4, 4)."""

    boards: BoardSet
    poses: Array


def add_boards(mesh: Mesh, rig: Rig, T_world_rig: Array) -> tuple[Mesh, PlacedBoards]:
    """Stand a board before every view of a rig at a place."""
    each = SQUARES[0] * SQUARES[1] // 2
    directions = view_directions(rig)[:MOST]
    boards = tuple(
        Board(f"board{k}", "charuco", SQUARES, SQUARE, MARKER, DICTIONARY, first_id=k * each)
        for k in range(len(directions))
    )
    poses = np.array([_facing(T_world_rig, direction, boards[0].size) for direction in directions])
    quads = [
        quad(T[:3, 3], T[:3, 0] * board.size[0], T[:3, 1] * board.size[1], Material(picture(board)))
        for T, board in zip(poses, boards)
    ]
    note = "rigid ChArUco boards that did not move between the photos"
    return joined([mesh, *quads]), PlacedBoards(BoardSet(boards, fixed=True, note=note), poses)


def view_directions(rig: Rig) -> list[Array]:
    """Mean directions in the rig frame of the views, without those that look almost the same way."""
    labels = rig.labels()
    chosen: list[Array] = []
    for index, name in enumerate(rig.view_names):
        rows, columns = np.nonzero(labels == index)
        step = max(1, len(rows) // 2000)
        _, rays = rig.ray(name, np.column_stack([columns, rows])[::step].astype(np.float64))
        mean = rays.mean(axis=0)
        mean /= np.linalg.norm(mean)
        if all(np.arccos(np.clip(mean @ other, -1, 1)) > APART for other in chosen):
            chosen.append(mean)
    return chosen


def picture(board: Board) -> NDArray[np.uint8]:
    """Draw a ChArUco board, RGB, TEXEL metres a texel."""
    layout = cv2.aruco.CharucoBoard(
        board.squares, board.square, board.marker or 0.0, board.markers_of_dictionary, np.array(board.ids)
    )
    size = tuple(round(length / TEXEL) for length in board.size)
    grey = np.asarray(layout.generateImage(size, marginSize=0), dtype=np.float64)
    return np.repeat(np.rint(BLACK + (WHITE - BLACK) / 255.0 * grey).astype(np.uint8)[..., None], 3, axis=2)


def round_the_boards(T_world_rig: Array, count: int, seed: int) -> Drive:
    """Poses of a rig that is turned, tilted and moved a little, so that boards wander through its views."""
    rng = np.random.default_rng([seed, 99])
    poses = []
    for _ in range(count):
        turn = np.radians([12.0, 12.0, 20.0]) * rng.uniform(-1, 1, 3)
        step = se3.exp([*turn, 0.0, 0.0, 0.0])
        step[:3, 3] = rng.uniform(-1, 1, 3) * (0.22, 0.22, 0.12)
        poses.append(T_world_rig @ step)
    return Drive(np.arange(count, dtype=np.float64), np.array(poses))


def write_board_truth(folder: Path, placed: PlacedBoards, photos: Drive, resumed: bool) -> None:
    """Write `boards.yaml`, and where boards and rig were."""
    if not (resumed and (folder / "boards.yaml").exists()):
        write_boards(placed.boards, folder / "boards.yaml")
    truth = {
        "T_world_board": {b.name: T.tolist() for b, T in zip(placed.boards.boards, placed.poses)},
        "T_world_rig": photos.poses.tolist(),
    }
    atomic_write(folder / "calibration_truth.json", json.dumps(truth) + "\n")


def _facing(T_world_rig: Array, direction: Array, size: tuple[float, float]) -> Array:
    """T_world_board of a board in a direction from the rig, upright as far as it goes; its z leads away."""
    away = T_world_rig[:3, :3] @ direction
    up = np.array([0.0, 0.0, 1.0]) if abs(away[2]) < 0.9 else np.array([0.0, 1.0, 0.0])
    right = np.cross(away, up)
    right /= np.linalg.norm(right)
    down = np.cross(away, right)
    T = np.eye(4)
    T[:3, :3] = np.column_stack([right, down, away])
    T[:3, 3] = T_world_rig[:3, 3] + DISTANCE * away - right * size[0] / 2 - down * size[1] / 2
    return T
