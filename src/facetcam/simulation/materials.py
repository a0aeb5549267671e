"""Procedural materials: pictures of wood, plaster, brick and cloth, made for a size in metres."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.uint8]  # (H, W, 3) RGB
Colour = tuple[int, int, int]
Material = Callable[[np.random.Generator, float, float], Picture]  # (rng, width, height in metres)

FINE = 0.002  # metres a texel
COARSE = 0.004


def canvas(width: float, height: float, texel: float, colour: Colour = (255, 255, 255)) -> Picture:
    """Return an empty picture for a surface of `width` x `height` metres."""
    shape = (max(2, round(height / texel)), max(2, round(width / texel)))
    return np.full((*shape, 3), colour, dtype=np.uint8)


def noise(rng: np.random.Generator, shape: tuple[int, ...], cell: tuple[float, float]) -> NDArray[np.float32]:
    """Smooth noise (H, W) of unit variance whose blotches are about `cell` texels (across, down) large."""
    height, width = shape[:2]
    grid = rng.standard_normal((round(height / cell[1]) + 3, round(width / cell[0]) + 3), dtype=np.float32)
    # A window one cell inside the grid, so that the repeated border is never seen.
    scale = np.array([[1 / cell[0], 0, 1], [0, 1 / cell[1], 1]])
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    return np.asarray(
        cv2.warpAffine(grid, scale, (width, height), flags=flags, borderMode=cv2.BORDER_REFLECT)
    )


def to_uint8(values: NDArray[np.floating[Any]]) -> Picture:
    """Round down to 0..255."""
    return np.asarray(np.clip(values, 0, 255), dtype=np.uint8)


def toned(picture: Picture, brightness: NDArray[np.floating[Any]]) -> Picture:
    """Multiply a picture by a brightness (H, W) around one."""
    return to_uint8(picture * brightness[..., None])


def varied(rng: np.random.Generator, colour: Colour, spread: float) -> Colour:
    """Return a colour a little brighter or darker than the given one."""
    factor = 1.0 + spread * rng.uniform(-1, 1)
    r, g, b = (int(np.clip(c * factor, 0, 255)) for c in colour)
    return r, g, b


def plaster(colour: Colour, roughness: float = 0.008) -> Material:
    """Make painted wall: nearly plain."""

    def paint(rng: np.random.Generator, width: float, height: float) -> Picture:
        wall = canvas(width, height, COARSE * 2, colour)
        blotches = 0.6 * noise(rng, wall.shape, (40, 40)) + noise(rng, wall.shape, (3, 3))
        return toned(wall, 1.0 + roughness * blotches)

    return paint


def plain(colour: Colour) -> Material:
    """Make smooth lacquer of one colour."""
    return lambda rng, width, height: canvas(width, height, 0.02, colour)


def wood(colour: Colour, contrast: float = 0.09) -> Material:
    """Make one board with its grain along the longer side."""

    def paint(rng: np.random.Generator, width: float, height: float) -> Picture:
        board = canvas(width, height, FINE * 1.5, varied(rng, colour, 0.06))
        along = (90.0, 2.5) if width >= height else (2.5, 90.0)
        wide = (300.0, 14.0) if width >= height else (14.0, 300.0)
        return toned(
            board, 1.0 + contrast * (0.6 * noise(rng, board.shape, along) + noise(rng, board.shape, wide))
        )

    return paint


def floor_boards(colour: Colour, board: float = 0.13) -> Material:
    """Make floor boards along the width, each of its own tone and length."""

    def paint(rng: np.random.Generator, width: float, height: float) -> Picture:
        floor = canvas(width, height, COARSE * 0.75, colour)
        texels = floor.shape[1] / width
        edges = np.arange(0.0, height, board) * texels
        for top in edges.astype(int):
            bottom = min(floor.shape[0], top + int(board * texels))
            left = -int(rng.uniform(0, 1.5) * texels)
            while left < floor.shape[1]:
                right = left + int(rng.uniform(0.8, 2.2) * texels)
                floor[top:bottom, max(left, 0) : right] = varied(rng, colour, 0.16)
                floor[top:bottom, max(right - 1, 0) : right] = (52, 36, 24)
                left = right
            floor[max(bottom - 1, 0) : bottom] = (60, 42, 28)
        grain = noise(rng, floor.shape, (60, 2)) * 0.05 + noise(rng, floor.shape, (200, 10)) * 0.06
        return toned(floor, 1.0 + grain)

    return paint


def bricks(colour: Colour, size: tuple[float, float] = (0.24, 0.075)) -> Material:
    """Make brickwork in running bond."""

    def paint(rng: np.random.Generator, width: float, height: float) -> Picture:
        wall = canvas(width, height, COARSE * 0.75, (186, 180, 170))
        texels = wall.shape[1] / width
        joint = 0.006 * texels
        for row in range(int(height / size[1]) + 1):
            for column in range(-1, int(width / size[0]) + 1):
                x = (column + 0.5 * (row % 2)) * size[0] * texels
                y = row * size[1] * texels
                corner = round(x + size[0] * texels - joint), round(y + size[1] * texels - joint)
                cv2.rectangle(
                    wall, (round(x + joint), round(y + joint)), corner, varied(rng, colour, 0.22), -1
                )
        return toned(
            wall, 1.0 + 0.05 * noise(rng, wall.shape, (3, 3)) + 0.03 * noise(rng, wall.shape, (25, 25))
        )

    return paint


def fabric(colour: Colour) -> Material:
    """Make woven cloth with soft folds."""

    def paint(rng: np.random.Generator, width: float, height: float) -> Picture:
        cloth = canvas(width, height, FINE * 2, colour)
        weave = 0.05 * noise(rng, cloth.shape, (1.6, 1.6)) + 0.05 * noise(rng, cloth.shape, (50, 50))
        return toned(cloth, 1.0 + weave)

    return paint


def wallpaper(ground: Colour, figure: Colour) -> Material:
    """Make wallpaper: broad stripes with a row of small leaves of changing size."""

    def paint(rng: np.random.Generator, width: float, height: float) -> Picture:
        wall = canvas(width, height, COARSE, ground)
        step = int(0.3 / COARSE)
        for x in range(0, wall.shape[1], step):
            wall[:, x : x + step // 3] = varied(rng, figure, 0.04)
            for y in range(int(rng.uniform(0, step)), wall.shape[0], step):
                axes = (int(rng.uniform(5, 9)), int(rng.uniform(10, 16)))
                tint = varied(rng, (150, 160, 130), 0.15)
                cv2.ellipse(
                    wall, (x + 2 * step // 3, y), axes, rng.uniform(-60, 60), 0, 360, tint, -1, cv2.LINE_AA
                )
        return wall

    return paint


def rug(colours: tuple[Colour, ...]) -> Material:
    """Make a rug: nested borders and a field of lozenges, no two alike."""

    def paint(rng: np.random.Generator, width: float, height: float) -> Picture:
        cloth = canvas(width, height, COARSE, colours[0])
        rows, columns = cloth.shape[:2]
        for i, inset in enumerate((0.04, 0.07, 0.16, 0.19)):
            d = int(inset / COARSE)
            cv2.rectangle(cloth, (d, d), (columns - d, rows - d), colours[1 + i % (len(colours) - 1)], -1)
        step = int(0.17 / COARSE)
        for y in range(int(0.3 / COARSE), rows - int(0.25 / COARSE), step):
            for x in range(int(0.3 / COARSE), columns - int(0.25 / COARSE), step):
                for scale in (0.46, 0.28, 0.12):
                    r = scale * step * rng.uniform(0.75, 1.0)
                    lozenge = np.array([[x - r, y], [x, y - r], [x + r, y], [x, y + r]], dtype=np.int32)
                    cv2.fillPoly(cloth, [lozenge], colours[rng.integers(len(colours))], cv2.LINE_AA)
        return toned(cloth, 1.0 + 0.07 * noise(rng, cloth.shape, (1.8, 1.8)))

    return paint


def cardboard(colour: Colour = (190, 150, 104)) -> Material:
    """Make a carton with tape, a label and printed marks."""

    def paint(rng: np.random.Generator, width: float, height: float) -> Picture:
        side = canvas(width, height, FINE, varied(rng, colour, 0.1))
        rows, columns = side.shape[:2]
        side = toned(side, 1.0 + 0.03 * noise(rng, side.shape, (2, 40)))
        middle = columns // 2
        side[:, middle - columns // 14 : middle + columns // 14] = (208, 186, 150)
        left, top = int(columns * rng.uniform(0.06, 0.3)), int(rows * rng.uniform(0.15, 0.4))
        right, bottom = left + int(columns * 0.36), top + int(rows * 0.42)
        side[top:bottom, left:right] = (244, 242, 236)
        for y in range(top + 6, bottom - 6, 7):
            cv2.line(
                side,
                (left + 6, y),
                (left + 6 + int((right - left - 14) * rng.uniform(0.3, 1)), y),
                (40,) * 3,
                2,
            )
        cv2.circle(side, (int(columns * 0.8), int(rows * 0.75)), rows // 10, (90, 50, 40), 3, cv2.LINE_AA)
        return side

    return paint
