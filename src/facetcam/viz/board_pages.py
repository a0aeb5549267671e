"""Boards to print: true-size pages as PDF and PNG."""

from __future__ import annotations

import io
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam.calibration.boards import Board
from facetcam.errors import ConfigError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

PAGES = {
    "A4": (210.0, 297.0), "A3": (297.0, 420.0), "A2": (420.0, 594.0), "A1": (594.0, 841.0),
    "A0": (841.0, 1189.0), "letter": (215.9, 279.4), "tabloid": (279.4, 431.8),
}  # fmt: skip
"""Width and height in millimetres."""

MARGIN_MM = 10.0  # what printers cannot reach, and white that markers need round them
FOOT_MM = 14.0  # the scale bar and the name
_MM_AN_INCH = 25.4
_MOST_PIXELS = 4.0e7


@dataclass(frozen=True)
class Page:
    """A sheet of paper in millimetres, turned so that the board fits, and where the board begins on it."""

    width: float
    height: float
    left: float
    top: float


def place(board: Board, paper: tuple[float, float]) -> Page:
    """Centre a board on paper (mm), upright or turned, its name and scale bar below.

    Raises
    ------
    ConfigError
        If it does not fit.
    """
    wide, high = (1000.0 * side for side in board.size)
    for width, height in (sorted(paper), sorted(paper, reverse=True)):
        if wide <= width - 2 * MARGIN_MM + 1e-6 and high <= height - 2 * MARGIN_MM - FOOT_MM + 1e-6:
            return Page(width, height, (width - wide) / 2, (height - FOOT_MM - high) / 2)
    raise ConfigError(
        f"board '{board.name}': {wide:.0f} x {high:.0f} mm do not fit on {paper[0]:g} x {paper[1]:g} mm with"
        f" margins of {MARGIN_MM:g} mm and the scale bar; take larger paper or smaller squares"
    )


def largest_square_mm(squares: tuple[int, int], paper: tuple[float, float]) -> float:
    """The largest whole millimetres a square can have on paper, upright or turned."""
    short, long_ = sorted(paper)
    fits = [
        min((w - 2 * MARGIN_MM) / squares[0], (h - 2 * MARGIN_MM - FOOT_MM) / squares[1])
        for w, h in ((short, long_), (long_, short))
    ]
    return math.floor(max(fits))


def black_shapes(board: Board) -> list[Array]:
    """All that is black: of each square and marker the rectangles (N, 4) x, y, width, height in metres."""
    columns, rows = board.squares
    side = board.square
    if board.kind == "aprilgrid":
        gap = side - (board.marker or 0.0)
        # Squares in the gaps make each corner of a tag one where four quarters meet.
        squares = [(x * side, y * side, gap, gap) for y in range(rows + 1) for x in range(columns + 1)]
    else:
        black = 1 if board.legacy and rows % 2 == 0 and board.kind == "charuco" else 0
        cells = ((x, y) for y in range(rows) for x in range(columns) if (x + y) % 2 == black)
        squares = [(x * side, y * side, side, side) for x, y in cells]
    markers = [
        _marker_rectangles(board, marker, corners[0, :2])
        for marker, corners in zip(board.ids, board.marker_corners)
    ]
    return [np.array([square]) for square in squares] + [np.array(cells) for cells in markers]


def _marker_rectangles(board: Board, marker: int, corner: Array) -> list[tuple[float, float, float, float]]:
    """The black cells of a marker, runs along a row joined."""
    dictionary = board.markers_of_dictionary
    cells = dictionary.markerSize + 2 * board.border
    bits = cv2.aruco.generateImageMarker(dictionary, marker, cells, None, board.border) == 0
    cell = (board.marker or 0.0) / cells
    found = []
    for y, row in enumerate(bits):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], row.astype(np.int8), [0]])))
        for first, last in zip(edges[::2], edges[1::2]):
            found.append((corner[0] + first * cell, corner[1] + y * cell, (last - first) * cell, cell))
    return found


def draw_board(board: Board, page: Page) -> Figure:
    """The page as a figure in millimetres."""
    from matplotlib.figure import Figure
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Outline

    figure = Figure(figsize=(page.width / _MM_AN_INCH, page.height / _MM_AN_INCH), facecolor="white")
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_axis_off()
    axes.set_xlim(0, page.width)
    axes.set_ylim(page.height, 0)
    for shape in black_shapes(board):
        x, y, w, h = (1000.0 * shape).T
        x, y = x + page.left, y + page.top
        corners = np.stack([[x, y], [x + w, y], [x + w, y + h], [x, y + h], [x, y]]).transpose(2, 0, 1)
        codes = [Outline.MOVETO, Outline.LINETO, Outline.LINETO, Outline.LINETO, Outline.CLOSEPOLY]
        # One path a marker, filled at once: no hairlines between its cells.
        outline = Outline(corners.reshape(-1, 2), np.tile(codes, len(x)))
        axes.add_patch(PathPatch(outline, facecolor="black", edgecolor="none", linewidth=0, snap=False))
    _foot(axes, board, page)
    return figure


def _foot(axes: Axes, board: Board, page: Page) -> None:
    """The scale bar, the name, and what the board is."""
    from matplotlib.patches import Rectangle

    bar = 100.0 if page.width >= 150.0 else 50.0
    top, left, right = page.height - MARGIN_MM - 8.0, MARGIN_MM, page.width - MARGIN_MM
    for part in range(10):
        begin = (left + part * bar / 10, top)
        colour = "black" if part % 2 == 0 else "white"
        axes.add_patch(Rectangle(begin, bar / 10, 2.5, facecolor=colour, edgecolor="black", linewidth=0.4))
    words = f"{bar:g} mm when printed at 100 %"
    axes.text(left + bar + 2.5, top + 1.3, words, fontsize=8, va="center")
    name = axes.text(right, top + 1.3, board.name, fontsize=11, ha="right", va="center", weight="bold")
    name.set_parse_math(False)  # a $ in a name is a $
    axes.text(left, top + 7.5, describe(board), fontsize=7, va="center", color="0.3")


def describe(board: Board) -> str:
    """A board in a line."""
    columns, rows = board.squares
    parts = [f"{board.kind} {columns} × {rows}", f"square {1000 * board.square:g} mm"]
    if board.marker is not None:
        parts[1] += f", marker {1000 * board.marker:g} mm"
        parts.append(f"{board.dictionary} ids {board.ids.start} to {board.ids.stop - 1}")
    return " · ".join(parts)


def resolution(page: Page) -> int:
    """Dots an inch of the PNG: 300, or fewer where that would be a huge picture."""
    square_inches = page.width * page.height / _MM_AN_INCH**2
    return int(min(300, math.sqrt(_MOST_PIXELS / square_inches)))


def to_bytes(figure: Figure, form: str, dpi: int) -> bytes:
    """The page as a `pdf` or `png` file."""
    import matplotlib as mpl

    buffer = io.BytesIO()
    with mpl.rc_context({"pdf.fonttype": 42}):
        figure.savefig(buffer, format=form, dpi=dpi, metadata={"CreationDate": None} if form == "pdf" else {})
    return buffer.getvalue()
