"""Procedural fronts of fittings and furniture: window, door, books, drawers, radiator, screen, clock."""

from __future__ import annotations

import cv2
import numpy as np

from facetcam.simulation.materials import FINE, Colour, Material, Picture, canvas, to_uint8, varied, wood
from facetcam.simulation.pictures import any_colour, landscape

Rng = np.random.Generator


def window(rng: Rng, width: float, height: float) -> Picture:
    """A view outside behind white bars."""
    outside = landscape(rng, width, height)
    rows, columns = outside.shape[:2]
    outside = to_uint8(outside * 0.6 + 110.0)
    for share in (0.0, 1 / 3, 2 / 3, 1.0):
        x = int(share * (columns - 1))
        cv2.line(outside, (x, 0), (x, rows), (236, 234, 228), 24 if share in (0.0, 1.0) else 14)
    for share in (0.0, 0.36, 1.0):
        y = int(share * (rows - 1))
        cv2.line(outside, (0, y), (columns, y), (236, 234, 228), 24 if share in (0.0, 1.0) else 14)
    return outside


def door(rng: Rng, width: float, height: float) -> Picture:
    """A panelled door in its frame, with a handle."""
    leaf = wood((172, 112, 66))(rng, width, height)
    rows, columns = leaf.shape[:2]
    texels = columns / width
    edge = int(0.06 * texels)
    cv2.rectangle(leaf, (0, 0), (columns, rows), (226, 220, 208), 2 * edge)
    cv2.rectangle(leaf, (edge, edge), (columns - edge, rows), (70, 46, 30), 2)
    for top, bottom in ((0.09, 0.42), (0.52, 0.92)):
        for left, right in ((0.17, 0.46), (0.54, 0.83)):
            a, b = (int(left * columns), int(top * rows)), (int(right * columns), int(bottom * rows))
            cv2.rectangle(leaf, a, b, (108, 66, 38), 5)
            cv2.line(leaf, (a[0], b[1]), b, (206, 150, 100), 3)
            cv2.line(leaf, (b[0], a[1]), b, (206, 150, 100), 3)
    y = int(0.48 * rows)
    cv2.rectangle(leaf, (int(0.875 * columns), y - 45), (int(0.915 * columns), y + 60), (196, 190, 170), -1)
    cv2.line(leaf, (int(0.895 * columns), y), (int(0.8 * columns), y), (120, 114, 100), 9, cv2.LINE_AA)
    return leaf


def books(rng: Rng, width: float, height: float) -> Picture:
    """Spines of books of different thickness and height in front of a dark back."""
    row = canvas(width, height, FINE * 0.75, (46, 34, 26))
    rows, columns = row.shape[:2]
    texels = columns / width
    x = 1
    while x < columns - 8:
        wide, top = int(rng.uniform(0.018, 0.05) * texels), int(rows * rng.uniform(0.02, 0.32))
        cover = varied(rng, any_colour(rng), 0.35)
        cv2.rectangle(row, (x, top), (min(x + wide - 1, columns), rows), cover, -1)
        for share in rng.uniform(0.08, 0.9, rng.integers(1, 4)):
            y = int(top + share * (rows - top))
            cv2.rectangle(
                row, (x, y), (x + wide - 1, y + rng.integers(2, 9)), varied(rng, (232, 214, 160), 0.25), -1
            )
        middle, length = x + wide // 2, (rows - top) * rng.uniform(0.2, 0.5)
        start = int(top + (rows - top) * 0.3)
        for y in range(start, int(start + length), 6):
            cv2.line(row, (middle - 2, y), (middle + rng.integers(0, 4), y), (240, 236, 226), 2)
        x += wide + (rng.random() < 0.08) * int(0.03 * texels)
    return row


def drawers(colour: Colour, across: int, down: int) -> Material:
    """Make the front of a cupboard with drawers and knobs."""

    def paint(rng: Rng, width: float, height: float) -> Picture:
        front = wood(colour, 0.05)(rng, width, height)
        rows, columns = front.shape[:2]
        for i in range(across):
            for j in range(down):
                a = (i * columns // across + 5, j * rows // down + 5)
                b = ((i + 1) * columns // across - 5, (j + 1) * rows // down - 5)
                cv2.rectangle(front, a, b, tuple(int(c * 0.45) for c in colour), 3)
                knob = ((a[0] + b[0]) // 2, a[1] + (b[1] - a[1]) // 3)
                cv2.circle(front, knob, 8, (214, 206, 186), -1, cv2.LINE_AA)
                cv2.circle(front, knob, 8, (80, 70, 60), 2, cv2.LINE_AA)
        return front

    return paint


def radiator(rng: Rng, width: float, height: float) -> Picture:
    """Vertical ribs of white steel."""
    panel = canvas(width, height, FINE * 2, (226, 226, 222))
    for x in range(0, panel.shape[1], 12):
        panel[8:-8, x : x + 3] = (168, 168, 166)
    panel[:3] = panel[-3:] = (150, 150, 150)
    return panel


def screen(rng: Rng, width: float, height: float) -> Picture:
    """A monitor that shows windows with text and a chart."""
    panel = canvas(width, height, FINE * 0.6, (36, 60, 92))
    rows, columns = panel.shape[:2]
    for left, top, right, bottom in ((0.05, 0.08, 0.55, 0.8), (0.48, 0.3, 0.95, 0.92)):
        x, y, x1, y1 = int(left * columns), int(top * rows), int(right * columns), int(bottom * rows)
        panel[y:y1, x:x1] = (242, 242, 240)
        panel[y : y + 10, x:x1] = (84, 92, 110)
        for line in range(y + 20, y1 - 8, 9):
            end = x + 8 + int((x1 - x - 16) * rng.uniform(0.2, 1.0))
            cv2.line(panel, (x + 8, line), (end, line), varied(rng, (90, 96, 130), 0.5), 3)
    return np.asarray(cv2.copyMakeBorder(panel, 12, 12, 12, 12, cv2.BORDER_CONSTANT, value=(20, 20, 22)))


def clock(rng: Rng, width: float, height: float) -> Picture:
    """A square clock."""
    face = canvas(width, height, FINE * 0.5, (52, 56, 64))
    r = face.shape[0] // 2
    cv2.circle(face, (r, r), int(r * 0.92), (246, 244, 238), -1, cv2.LINE_AA)
    for hour in range(12):
        along = np.array([np.sin(hour * np.pi / 6), -np.cos(hour * np.pi / 6)])
        a, b = ((r + along * r * share).astype(int).tolist() for share in (0.7, 0.86))
        cv2.line(face, a, b, (20, 20, 24), 4, cv2.LINE_AA)
    cv2.line(face, (r, r), (int(r * 1.35), int(r * 0.7)), (20, 20, 24), 6, cv2.LINE_AA)
    cv2.line(face, (r, r), (int(r * 0.72), int(r * 0.4)), (160, 30, 30), 4, cv2.LINE_AA)
    return face
