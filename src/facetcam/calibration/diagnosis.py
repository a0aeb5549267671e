"""Why no board is found, or not the whole of it: the dictionary or layout that would fit the photos."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam.calibration.boards import DICTIONARIES, MARKED, Board, BoardSet
from facetcam.calibration.markers import Markers, fitting_pairs, project, read_markers
from facetcam.errors import ConfigError

Image = NDArray[np.uint8]

_LEAST_MARKERS = 6  # of another dictionary before it is suggested
_CLEARLY = 1.5  # times as many neighbours that fit, before another layout is suggested
_MOST_COLUMNS = 24
_WIDTH = 1600  # pixels of a photo in which other dictionaries are looked for


def wanted(boards: BoardSet) -> str:
    """What is looked for, in words."""
    return "; ".join(describe(board) for board in boards.boards)


def describe(board: Board) -> str:
    """One board in words."""
    columns, rows = board.squares
    if board.kind not in MARKED:
        return f"{board.name} (chessboard of {columns - 1}x{rows - 1} inner corners)"
    return (
        f"{board.name} ({board.kind} {columns}x{rows}, {board.dictionary} ids {board.ids[0]}-{board.ids[-1]})"
    )


def better_dictionary(images: Iterable[Image], boards: BoardSet) -> str:
    """The dictionary whose markers the photos show, in a sentence; empty where none stands out.

    Parameters
    ----------
    images : iterable of (H, W) uint8 arrays
        A few photos.
    boards : BoardSet
    """
    border = next((b.border for b in boards.boards if b.kind in MARKED), 1)
    told = {b.family for b in boards.boards}
    for image in images:
        scale = min(1.0, _WIDTH / image.shape[1])
        small = np.asarray(
            cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8
        )
        read = {name: _ids_read(small, name, border) for name in _families()}
        best = max(read, key=lambda name: len(read[name]))
        if len(read[best]) >= _LEAST_MARKERS and not {best, best.rpartition("_")[0]} & told:
            name = _smallest(best, max(read[best]))
            return f"the photos show markers of {name}, ids up to {max(read[best])}"
    return ""


def _ids_read(image: Image, dictionary: str, border: int) -> set[int]:
    """Ids of a dictionary's markers in the photo or its mirror image, whichever has more."""
    board = Board("probe", "charuco", (3, 3), 2.0, 1.0, dictionary, border=border)
    plain, mirrored = (set(read_markers(image, board, m).ids.tolist()) for m in (False, True))
    return plain if len(plain) >= len(mirrored) else mirrored


def better_layout(images: Sequence[Image], board: Board) -> str:
    """What of a board's description does not fit the photos, in a sentence; empty where it does.

    Neighbouring markers are compared with the plan of the board, then with plans of other columns, of the
    older pattern, and of other sizes of the markers.
    """
    if board.kind not in MARKED:
        return ""
    readings = [read_markers(image, board, mirrored) for image in images for mirrored in (False, True)]

    def score(candidate: Board) -> int:
        return sum(fitting_pairs(found, candidate) for found in readings)

    as_told = score(board)
    best, most = board, as_told
    for candidate in (*_variations(board), *_resized(readings, board)):
        fitting = score(candidate)
        if fitting > most:
            best, most = candidate, fitting
    if best is board or most < max(_LEAST_MARKERS, _CLEARLY * as_told):
        return ""
    told = f"board '{board.name}': the photos do not show what boards.yaml says"
    if best.squares[0] != board.squares[0]:
        return f"{told}; {best.squares[0]} columns would fit, not {board.squares[0]}"
    if best.legacy != board.legacy:
        return f"{told}; 'legacy: {str(best.legacy).lower()}' would fit"
    return f"{told}; a marker of about {best.marker:.4g} m would fit, not {board.marker:g}"


def _variations(board: Board) -> Iterable[Board]:
    rows = board.squares[1]
    for columns in range(3, _MOST_COLUMNS + 1):
        for legacy in {False, board.kind == "charuco"}:
            # Rows only count: as many as the ids of the described board need.
            needed = int(np.ceil(2 * len(board.ids) / columns)) if board.kind == "charuco" else rows
            fitted = max(3, needed + (needed - rows) % 2)
            yield from _possible(board, squares=(columns, fitted), legacy=legacy)


def _resized(readings: Sequence[Markers], board: Board) -> Iterable[Board]:
    """The board with its markers as large as they are seen, where the plan of their middles fits."""
    plan = board.marker_corners[:, :, :2]
    sides: list[float] = []
    for found in readings:
        mine = (found.ids >= board.ids.start) & (found.ids < board.ids.stop)
        if mine.sum() < _LEAST_MARKERS:
            continue
        middles = plan[found.ids[mine] - board.ids.start].mean(axis=1)
        H, fits = cv2.findHomography(found.quads[mine].mean(axis=1), middles, cv2.RANSAC, 0.1 * board.square)
        if H is None or fits.sum() < _LEAST_MARKERS:
            continue
        corners = project(np.asarray(H), found.quads[mine].reshape(-1, 2)).reshape(-1, 4, 2)
        lengths = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean(axis=1)
        sides += lengths[fits.ravel() > 0].tolist()
    if sides:
        yield from _possible(board, marker=float(f"{np.median(sides):.2g}"))


def _possible(board: Board, **changes: object) -> Iterable[Board]:
    try:
        yield replace(board, **changes)  # type: ignore[arg-type]
    except ConfigError:
        return


def _families() -> list[str]:
    """One dictionary of each family; of those that contain each other the one of 250, which is read fast."""
    numbered = {name.rpartition("_")[0] for name in DICTIONARIES if name.rpartition("_")[2] == "250"}
    by_value = {DICTIONARIES[name]: name for name in sorted(DICTIONARIES)}  # AprilTags stand there twice
    alone = [name for name in by_value.values() if name.rpartition("_")[0] not in numbered]
    return [f"{family}_250" for family in sorted(numbered)] + alone


def _smallest(name: str, highest: int) -> str:
    """The smallest dictionary of the family that has the id."""
    stem, _, count = name.rpartition("_")
    if not count.isdigit():
        return name
    sizes = sorted(int(n.rpartition("_")[2]) for n in DICTIONARIES if n.rpartition("_")[0] == stem)
    return f"{stem}_{next((size for size in sizes if size > highest), sizes[-1])}"


def draw_what_is_seen(image: Image, boards: BoardSet) -> NDArray[np.uint8]:
    """The photo with every marker that was read, green, or looked like one and could not be read, red."""
    picture = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    for board in boards.boards:
        if board.kind not in MARKED:
            continue
        detector = cv2.aruco.ArucoDetector(board.markers_of_dictionary)
        corners, ids, refused = detector.detectMarkers(image)
        cv2.aruco.drawDetectedMarkers(picture, refused, borderColor=(60, 60, 230))
        if ids is not None:
            cv2.aruco.drawDetectedMarkers(picture, corners, ids, (60, 200, 60))
    return np.asarray(picture, np.uint8)
