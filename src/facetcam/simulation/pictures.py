"""Procedural pictures to hang up: posters, a calendar, a board with notes, and their frames."""

from __future__ import annotations

import cv2
import numpy as np

from facetcam.simulation.materials import (
    FINE,
    Colour,
    Material,
    Picture,
    canvas,
    noise,
    to_uint8,
    toned,
    varied,
)

Rng = np.random.Generator

PALETTE: tuple[Colour, ...] = (
    (196, 58, 44),
    (36, 84, 148),
    (238, 190, 60),
    (34, 34, 40),
    (60, 130, 96),
    (232, 226, 212),
    (222, 128, 52),
    (120, 168, 196),
)


def any_colour(rng: Rng) -> Colour:
    """One colour of the palette."""
    return PALETTE[rng.integers(len(PALETTE))]


def mosaic(rng: Rng, width: float, height: float) -> Picture:
    """Rectangles split again and again, with black lines between them."""
    sheet = canvas(width, height, FINE * 0.75, (240, 236, 226))
    blocks = [(0, 0, sheet.shape[1], sheet.shape[0])]
    for _ in range(26):
        x, y, w, h = blocks.pop(int(np.argmax([w * h * rng.uniform(0.3, 1) for _, _, w, h in blocks])))
        share = rng.uniform(0.3, 0.7)
        if w > h:
            cut = int(w * share)
            blocks += [(x, y, cut, h), (x + cut, y, w - cut, h)]
        else:
            cut = int(h * share)
            blocks += [(x, y, w, cut), (x, y + cut, w, h - cut)]
    for x, y, w, h in blocks:
        colour = any_colour(rng) if rng.random() < 0.6 else (240, 236, 226)
        cv2.rectangle(sheet, (x, y), (x + w, y + h), colour, -1)
        cv2.rectangle(sheet, (x, y), (x + w, y + h), (24, 24, 26), 4)
    return sheet


def circles(rng: Rng, width: float, height: float) -> Picture:
    """Concentric circles in a grid of squares."""
    sheet = canvas(width, height, FINE * 0.75)
    cell = min(sheet.shape[:2]) // 3
    for y in range(0, sheet.shape[0], cell):
        for x in range(0, sheet.shape[1], cell):
            cv2.rectangle(sheet, (x, y), (x + cell, y + cell), any_colour(rng), -1)
            for share in (0.46, 0.36, 0.25, 0.13):
                radius = int(cell * share * rng.uniform(0.85, 1.05))
                cv2.circle(sheet, (x + cell // 2, y + cell // 2), radius, any_colour(rng), -1, cv2.LINE_AA)
    return sheet


def landscape(rng: Rng, width: float, height: float) -> Picture:
    """Sky, sun, three ranges of hills and a few trees."""
    sheet = canvas(width, height, FINE)
    rows, columns = sheet.shape[:2]
    fade = np.linspace(0, 1, rows)[:, None, None]
    sheet[:] = to_uint8((1 - fade) * (96, 150, 210) + fade * (250, 214, 170))
    clouds = np.clip(noise(rng, sheet.shape, (columns / 5, rows / 12)) * 0.5, 0, 0.6)[..., None]
    sheet = to_uint8(sheet * (1 - clouds) + 250 * clouds)
    sun = (int(columns * rng.uniform(0.2, 0.8)), rows // 4)
    cv2.circle(sheet, sun, rows // 12, (255, 236, 170), -1, cv2.LINE_AA)
    for level, colour in ((0.48, (120, 140, 160)), (0.62, (92, 124, 100)), (0.78, (64, 96, 58))):
        ridge = rows * (level - 0.06 * noise(rng, (1, columns), (columns / 6, 1))[0])
        outline = np.column_stack([np.arange(columns), ridge]).astype(np.int32)
        outline = np.concatenate([outline, [[columns, rows], [0, rows]]]).astype(np.int32)
        cv2.fillPoly(sheet, [outline], colour, cv2.LINE_AA)
    for x in rng.uniform(0, columns, 9).astype(int):
        foot, top = int(rows * rng.uniform(0.82, 0.97)), int(rows * rng.uniform(0.58, 0.74))
        half = (foot - top) // 4
        tree = np.array([[x, top], [x - half, foot], [x + half, foot]], dtype=np.int32)
        cv2.fillPoly(sheet, [tree], varied(rng, (34, 66, 40), 0.3), cv2.LINE_AA)
    return sheet


def skyline(rng: Rng, width: float, height: float) -> Picture:
    """A city at night: towers with lit windows."""
    sheet = canvas(width, height, FINE * 0.75, (28, 34, 62))
    rows, columns = sheet.shape[:2]
    x = 0
    while x < columns:
        wide, top = int(columns * rng.uniform(0.07, 0.16)), int(rows * rng.uniform(0.2, 0.65))
        cv2.rectangle(sheet, (x, top), (x + wide, rows), varied(rng, (70, 74, 100), 0.4), -1)
        for wy in range(top + 8, rows - 8, 14):
            for wx in range(x + 6, x + wide - 8, 13):
                lit = (250, 220, 130) if rng.random() < 0.45 else (46, 50, 70)
                cv2.rectangle(sheet, (wx, wy), (wx + 6, wy + 8), lit, -1)
        x += wide + int(columns * 0.01)
    return sheet


def notes(rng: Rng, width: float, height: float) -> Picture:
    """A cork board with slips of paper pinned to it."""
    board = canvas(width, height, FINE, (176, 128, 78))
    board = toned(board, 1.0 + 0.12 * noise(rng, board.shape, (2.5, 2.5)))
    rows, columns = board.shape[:2]
    for _ in range(16):
        size = rng.uniform(0.1, 0.2, 2) / FINE
        centre = rng.uniform(0.1, 0.9, 2) * (columns, rows)
        corners = cv2.boxPoints((tuple(centre), tuple(size), rng.uniform(-14, 14))).astype(np.int32)
        paper = varied(
            rng, ((250, 240, 150), (245, 245, 240), (180, 220, 240), (250, 190, 180))[rng.integers(4)], 0.04
        )
        cv2.fillPoly(board, [corners], paper, cv2.LINE_AA)
        for share in np.arange(0.2, 0.9, 0.14):
            start, end = (corners[i] * (1 - share) + corners[j] * share for i, j in ((1, 0), (2, 3)))
            span = start + (end - start) * rng.uniform(0.4, 0.85)
            cv2.line(
                board,
                *((start * 0.9 + end * 0.1).astype(int).tolist(), span.astype(int).tolist()),
                (70, 70, 90),
                1,
                cv2.LINE_AA,
            )
        cv2.circle(board, centre.astype(int).tolist(), 4, any_colour(rng), -1, cv2.LINE_AA)
    return board


def calendar(rng: Rng, width: float, height: float) -> Picture:
    """A month of numbered days under a small landscape."""
    sheet = canvas(width, height, FINE * 0.75)
    rows, columns = sheet.shape[:2]
    image = landscape(rng, width, height * 0.5)
    sheet[: rows // 2] = cv2.resize(image, (columns, rows // 2), interpolation=cv2.INTER_AREA)
    for day in range(35):
        x, y = day % 7 * columns // 7, rows // 2 + day // 7 * (rows - rows // 2) // 5
        cv2.rectangle(sheet, (x, y), (x + columns // 7, y + rows // 10), (120, 120, 120), 1)
        colour = (200, 40, 40) if day % 7 == 6 else (30, 30, 40)
        cv2.putText(
            sheet,
            str(day % 31 + 1),
            (x + 6, y + rows // 14),
            cv2.FONT_HERSHEY_SIMPLEX,
            0.5,
            colour,
            1,
            cv2.LINE_AA,
        )
    return sheet


def framed(inside: Material, frame: Colour, border: float = 0.035, mat: float = 0.05) -> Material:
    """Put a picture behind a mat and into a wooden frame."""

    def paint(rng: Rng, width: float, height: float) -> Picture:
        picture = inside(rng, width - 2 * (border + mat), height - 2 * (border + mat))
        texel = (width - 2 * (border + mat)) / picture.shape[1]
        for thickness, colour in ((mat, (238, 234, 224)), (0.003, (70, 60, 50)), (border - 0.003, frame)):
            n = max(1, round(thickness / texel))
            picture = cv2.copyMakeBorder(picture, n, n, n, n, cv2.BORDER_CONSTANT, value=colour)
        return np.asarray(picture)

    return paint
