"""Photos of a board, made by warping its drawing: quick, and true to where its corners are."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam.calibration import Board
from facetcam.viz.board_pages import black_shapes

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

BOARD = Board("wall", "charuco", (6, 5), 0.03, 0.022, "DICT_4X4_50")
SIZE = (640, 480)
PIXELS = 2000  # a metre of the drawing


def drawing(board: Board) -> Image:
    """The board with a white rim, `PIXELS` a metre."""
    width, height = (round(PIXELS * side) for side in board.size)
    image = np.full((height, width), 255, np.uint8)
    for x, y, w, h in np.concatenate(black_shapes(board)) * PIXELS:
        image[round(y) : round(y + h), round(x) : round(x + w)] = 0
    return cv2.copyMakeBorder(image, 20, 20, 20, 20, cv2.BORDER_CONSTANT, value=255)


def seen(board: Board, K: Array, T_cam_board: Array, size: tuple[int, int], seed: int = 0) -> Image:
    """A photo of the board where it stands before a camera without distortion, or as a mirror has it."""
    rim = 20.0  # texels
    finer = 3  # samples across a pixel
    texels = np.array([[1, 0, 0.5 - rim], [0, 1, 0.5 - rim], [0, 0, PIXELS]]) / PIXELS
    samples = np.array([[finer, 0, (finer - 1) / 2], [0, finer, (finer - 1) / 2], [0, 0, 1.0]])
    H = samples @ K @ T_cam_board[:3, [0, 1, 3]] @ texels
    fine = cv2.warpPerspective(
        drawing(board), H, (finer * size[0], finer * size[1]), flags=cv2.INTER_LINEAR, borderValue=120
    )
    noise = np.random.default_rng(seed).normal(0, 1.5, size[::-1])
    blurred = cv2.GaussianBlur(cv2.resize(fine, size, interpolation=cv2.INTER_AREA), (0, 0), 0.6)
    return np.clip(0.8 * blurred + 20 + noise, 0, 255).astype(np.uint8)


def photo(board: Board = BOARD, seed: int = 0, spread: float = 50.0, size: tuple[int, int] = SIZE) -> Image:
    """A photo of the board with corners moved by up to `spread` pixels."""
    rng = np.random.default_rng(seed)
    flat = drawing(board)
    w, h = size
    quad = np.array([[0.15, 0.15], [0.85, 0.15], [0.85, 0.85], [0.15, 0.85]]) * (w, h)
    quad += rng.uniform(-spread, spread, (4, 2))
    edge = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * (flat.shape[1] - 1, flat.shape[0] - 1)
    H = cv2.getPerspectiveTransform(edge.astype(np.float32), quad.astype(np.float32))
    seen = cv2.warpPerspective(flat, H, size, flags=cv2.INTER_AREA, borderValue=120)
    noisy = cv2.GaussianBlur(seen, (0, 0), 0.7) * 0.8 + 20 + rng.normal(0, 1.5, seen.shape)
    return np.clip(noisy, 0, 255).astype(np.uint8)


def write_photos(folder: Path, images: list[Image], suffix: str = ".png") -> Path:
    """Write `00.png`, ... into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for index, image in enumerate(images):
        cv2.imwrite(str(folder / f"{index:02d}{suffix}"), image)
    return folder
