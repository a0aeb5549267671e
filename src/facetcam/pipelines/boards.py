"""Boards to print, with the `boards.yaml` that describes them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from facetcam.calibration.board_files import read_boards, write_boards
from facetcam.calibration.boards import MARKED, Board, BoardSet, Kind
from facetcam.errors import ConfigError
from facetcam.io.outputs import atomic_write, fresh_folder, require_absent
from facetcam.viz.board_pages import PAGES, draw_board, largest_square_mm, place, resolution, to_bytes

MARKER_SHARE = 0.75  # of a square; of a charuco marker it leaves an eighth of white on each side


@dataclass(frozen=True, slots=True)
class Printed:
    """The boards, and the paper (mm) that each was put on."""

    boards: BoardSet
    paper: tuple[float, float]
    folder: Path


def make_boards(
    kind: Kind = "charuco",
    count: int = 4,
    squares: tuple[int, int] = (7, 10),
    square: float | None = None,
    marker: float | None = None,
    dictionary: str | None = None,
    paper: tuple[float, float] = PAGES["A4"],
    fixed: bool = False,
) -> BoardSet:
    """Several boards of one kind with disjoint ids.

    Parameters
    ----------
    kind : str
    count : int
    squares : (int, int)
        Columns and rows.
    square, marker : float, optional
        Metres; without them as large as the paper allows, and three quarters of that.
    dictionary : str, optional
    paper : (float, float)
        Millimetres.
    fixed : bool
        Whether they will stand still against each other.

    Raises
    ------
    ConfigError
        If the ids do not fit the dictionary, or a size is wrong.
    """
    side = square if square is not None else largest_square_mm(squares, paper) / 1000.0
    if kind == "aprilgrid" and square is None:  # a gap more than tags
        side = int(1000.0 * side * squares[0] / (squares[0] + 1 - MARKER_SHARE)) / 1000.0
    marked = kind in MARKED
    code = dictionary or ("DICT_APRILTAG_36h11" if kind == "aprilgrid" else "DICT_5X5_1000")
    boards: list[Board] = []
    for number in range(count):
        boards.append(
            Board(
                f"{kind}-{number + 1}",
                kind,
                squares,
                side,
                (marker if marker is not None else round(MARKER_SHARE * side, 5)) if marked else None,
                code if marked else None,
                boards[-1].ids.stop if boards else 0,
            )
        )
    return BoardSet(tuple(boards), fixed)


def run_boards(
    boards: BoardSet | Path | str, out: Path | str, paper: tuple[float, float] = PAGES["A4"]
) -> Printed:
    """Write each board as `NAME.pdf` and `NAME.png`, true to size, and `boards.yaml`.

    Parameters
    ----------
    boards : BoardSet or path
        From `make_boards`, or a `boards.yaml`.
    out : path
        Folder to make.
    paper : (float, float)
        Millimetres.

    Raises
    ------
    FacetcamError
        Before `out` is made, if a board does not fit the paper; later, if a file cannot be written.
    """
    require_absent(out)
    chosen = boards if isinstance(boards, BoardSet) else read_boards(boards)
    for board in chosen.boards:
        if Path(board.name).name != board.name or board.name.startswith("."):
            raise ConfigError(f"board '{board.name}': cannot name a file; rename it")
    pages = [place(board, paper) for board in chosen.boards]
    folder = fresh_folder(out)
    for board, page in zip(chosen.boards, pages):
        figure = draw_board(board, page)
        for form in ("pdf", "png"):
            atomic_write(folder / f"{board.name}.{form}", to_bytes(figure, form, resolution(page)))
    write_boards(chosen, folder / "boards.yaml")
    return Printed(chosen, paper, folder)
