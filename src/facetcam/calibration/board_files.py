"""Reading and writing `boards.yaml`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from facetcam.calibration.boards import MARKED, Board, BoardSet, Kind
from facetcam.config import from_mapping, read_yaml
from facetcam.errors import ConfigError


@dataclass(frozen=True)
class _BoardEntry:
    name: str
    type: Kind
    squares: tuple[int, int]
    square: float
    marker: float | None = None
    dictionary: str | None = None
    first_id: int = 0
    legacy: bool = False
    border: int = 1


@dataclass(frozen=True)
class _File:
    boards: tuple[_BoardEntry, ...]
    fixed: bool = False
    note: str = ""


def read_boards(path: Path | str) -> BoardSet:
    """Read a `boards.yaml`.

    Raises
    ------
    ConfigError
        If it cannot be read, has an unknown or missing key, or describes boards that cannot be.
    """
    file = from_mapping(_File, read_yaml(Path(path)), str(path))
    try:
        boards = tuple(
            Board(kind=e.type, **{k: v for k, v in vars(e).items() if k != "type"}) for e in file.boards
        )
        return BoardSet(boards, file.fixed, file.note)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from error


def boards_document(boards: BoardSet) -> dict[str, Any]:
    """The content of a `boards.yaml`."""
    return {
        **({"note": boards.note} if boards.note else {}),
        "fixed": boards.fixed,
        "boards": [_entry(board) for board in boards.boards],
    }


def write_boards(boards: BoardSet, path: Path | str) -> None:
    """Write a `boards.yaml`; an existing file is not replaced.

    Raises
    ------
    ConfigError
        If it exists or cannot be written.
    """
    text = yaml.safe_dump(boards_document(boards), sort_keys=False, default_flow_style=None, width=110)
    try:
        with Path(path).open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise ConfigError(f"{path}: exists already; choose another name") from None
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written ({error.strerror})") from error


def _entry(board: Board) -> dict[str, Any]:
    entry: dict[str, Any] = {"name": board.name, "type": board.kind, "squares": list(board.squares)}
    entry["square"] = board.square
    if board.kind in MARKED:
        entry |= {"marker": board.marker, "dictionary": board.dictionary, "first_id": board.first_id}
    entry |= {"legacy": True} if board.legacy else {}
    return entry | ({"border": board.border} if board.border != 1 else {})
