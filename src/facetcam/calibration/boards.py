"""Calibration boards: where their points are and which markers they carry."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from functools import cached_property
from itertools import combinations
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam.config import nearest
from facetcam.errors import ConfigError

Array = NDArray[np.float64]
Kind = Literal["charuco", "chessboard", "aprilgrid"]

MARKED = ("charuco", "aprilgrid")
DICTIONARIES = {
    name: getattr(cv2.aruco, name)
    for name in dir(cv2.aruco)
    if name.startswith("DICT_") and isinstance(getattr(cv2.aruco, name), int)
}
SQUARES = 5e-4, 2.0  # metres; other numbers are in other units
MOST_SQUARES = 500  # a side; beyond, no photo would resolve them


@dataclass(frozen=True)
class Board:
    """One flat board.

    Its frame has the origin in the upper left corner of the pattern, x to the right, y down and so z into the
    board, away from who looks at it.

    Parameters
    ----------
    name : str
    kind : str
        `charuco`, `chessboard` or `aprilgrid`.
    squares : (int, int)
        Columns and rows of squares; of tags for an aprilgrid.
    square : float
        Side of a square in metres; for an aprilgrid from one tag's edge to the same edge of the next.
    marker : float, optional
        Side of a marker or tag, black border included, in metres.
    dictionary : str, optional
        Name of OpenCV's predefined dictionary of markers.
    first_id : int
        Id of the first marker. Ids grow along the rows; from the top for charuco, from the bottom for an
        aprilgrid, as Kalibr has them.
    legacy : bool
        Charuco only: even rows begin with a white square, as in OpenCV before 4.6.
    border : int
        Black cells round a marker's code: 1, or 2 for the tags that Kalibr prints.

    Raises
    ------
    ConfigError
        If the board cannot be.
    """

    name: str
    kind: Kind
    squares: tuple[int, int]
    square: float
    marker: float | None = None
    dictionary: str | None = None
    first_id: int = 0
    legacy: bool = False
    border: int = 1

    def __post_init__(self) -> None:
        least = 1 if self.kind == "aprilgrid" else 3
        if not all(least <= n <= MOST_SQUARES for n in self.squares):
            raise self._error(f"squares {list(self.squares)} must be {least} to {MOST_SQUARES} a side")
        if not 0.0 < self.square < np.inf:
            raise self._error(f"square {self.square:g} must be a length in metres above zero")
        if not SQUARES[0] <= self.square <= SQUARES[1]:
            raise self._error(
                f"square {self.square:g} is in metres, the board would be {max(self.size):.3g} m wide;"
                " give square and marker in metres, as 0.06 for 60 mm"
            )
        if self.kind in MARKED:
            self._check_markers()
        elif self.marker is not None or self.dictionary is not None:
            raise self._error("a plain chessboard has no markers; remove marker and dictionary")

    def _check_markers(self) -> None:
        if self.marker is None or self.dictionary is None:
            raise self._error(f"a {self.kind} board needs 'marker' (metres) and 'dictionary'")
        if not 0.0 < self.marker < self.square:
            raise self._error(f"marker {self.marker:g} must be shorter than the square, {self.square:g}")
        if self.border not in (1, 2):
            raise self._error(f"border {self.border} must be 1 or 2 cells")
        if self.dictionary not in DICTIONARIES:
            raise self._error(
                f"unknown dictionary {self.dictionary!r}; {nearest(self.dictionary, DICTIONARIES)}"
            )
        most = len(self.markers_of_dictionary.bytesList)
        if self.first_id < 0 or self.ids.stop > most:
            raise self._error(
                f"ids {self.first_id} to {self.ids.stop - 1} leave {self.dictionary}, which has {most};"
                " take a larger dictionary or fewer squares"
            )

    def _error(self, reason: str) -> ConfigError:
        return ConfigError(f"board '{self.name}': {reason}")

    @property
    def markers_of_dictionary(self) -> cv2.aruco.Dictionary:
        """OpenCV's dictionary."""
        return cv2.aruco.getPredefinedDictionary(DICTIONARIES[self.dictionary or ""])

    @property
    def family(self) -> str:
        """Dictionaries of one family share their codes: DICT_5X5_50 is the beginning of DICT_5X5_250."""
        name = self.dictionary or ""
        return name.rpartition("_")[0] if name.rpartition("_")[2].isdigit() else name

    @cached_property
    def ids(self) -> range:
        """Ids of its markers; empty for a chessboard."""
        columns, rows = self.squares
        if self.kind == "charuco":
            return range(self.first_id, self.first_id + columns * rows // 2)
        return range(self.first_id, self.first_id + (columns * rows if self.kind == "aprilgrid" else 0))

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the pattern in metres."""
        columns, rows = self.squares
        if self.kind == "aprilgrid":  # black squares stand in the gaps, at the outer ones too
            gap = self.square - (self.marker or 0.0)
            return columns * self.square + gap, rows * self.square + gap
        return columns * self.square, rows * self.square

    @property
    def corner_square(self) -> float:
        """Side in metres of the squares that meet at a corner; as large as nothing else is near it.

        Tags of an aprilgrid meet squares as small as the gap, and have their code behind the border.
        """
        if self.kind != "aprilgrid" or self.marker is None:
            return self.square
        cell = self.marker / (self.markers_of_dictionary.markerSize + 2 * self.border)
        return min(2.0 * (self.square - self.marker), 7.0 * cell * self.border, self.square)

    @cached_property
    def points(self) -> Array:
        """Points to find, (N, 3) metres, z = 0: inner corners by rows; of an aprilgrid four corners a tag."""
        if self.kind == "aprilgrid":
            return _fixed(self.marker_corners.reshape(-1, 3))
        columns, rows = self.squares
        y, x = np.mgrid[1:rows, 1:columns]
        return _fixed(self.square * np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1))

    @cached_property
    def marker_corners(self) -> Array:
        """Corners (M, 4, 3) of the markers in the order of `ids`: upper left, then clockwise."""
        columns, rows = self.squares
        side = self.marker or 0.0
        gap = self.square - side
        if self.kind == "aprilgrid":
            cells = [(x, y) for y in reversed(range(rows)) for x in range(columns)]
            corner = self.square * np.array(cells, dtype=np.float64) + gap
        else:
            odd = 0 if self.legacy and rows % 2 == 0 else 1  # parity of x + y on white squares
            cells = [(x, y) for y in range(rows) for x in range(columns) if (x + y) % 2 == odd]
            corner = self.square * np.array(cells, dtype=np.float64).reshape(-1, 2) + gap / 2
        quad = side * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
        flat = corner[: len(self.ids), None] + quad
        return _fixed(np.concatenate([flat, np.zeros((*flat.shape[:2], 1))], axis=2))


@dataclass(frozen=True)
class BoardSet:
    """Boards used together.

    Parameters
    ----------
    boards : tuple of Board
    fixed : bool
        Whether they did not move against each other between the photos.
    note : str
        Remark of the user.

    Raises
    ------
    ConfigError
        If there is none, or two share a name or an id.
    """

    boards: tuple[Board, ...]
    fixed: bool = False
    note: str = ""

    def __post_init__(self) -> None:
        if not self.boards:
            raise ConfigError("boards: there is none; list at least one")
        for one, other in combinations(self.boards, 2):
            if one.name == other.name:
                raise ConfigError(f"boards: two are named '{one.name}'; give each a name of its own")
            shared = range(max(one.ids.start, other.ids.start), min(one.ids.stop, other.ids.stop))
            if one.family == other.family and len(shared):
                raise ConfigError(
                    f"boards '{one.name}' and '{other.name}' share the ids {shared.start} to"
                    f" {shared.stop - 1} of {one.family}; give '{other.name}' first_id: {one.ids.stop}"
                )

    @cached_property
    def digest(self) -> str:
        """SHA-256 of all that matters for what is found in a photo."""
        return hashlib.sha256(json.dumps([asdict(b) for b in self.boards]).encode()).hexdigest()


def _fixed(points: Array) -> Array:
    points.flags.writeable = False
    return points
