"""Plain tables of numbers: one row a line, `#` starts a comment."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from facetcam.errors import SourceError

LATEST = 1e11  # seconds: the year 5138; Unix times in milli- or nanoseconds lie beyond


def rows_of_table(path: Path, separator: str | None = None) -> Iterator[tuple[int, list[str]]]:
    """Line number and fields of each line that is neither blank nor a comment."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise SourceError(f"{path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise SourceError(f"{path}: not a text file") from error
    for number, line in enumerate(text.splitlines(), start=1):
        content = line.split("#", 1)[0].strip()
        if content:
            yield number, [field.strip() for field in content.split(separator)]


def read_numbers(path: Path, columns: str, header: bool = False) -> NDArray[np.float64]:
    """Read a table of finite numbers whose first column, the time, increases.

    Parameters
    ----------
    path : Path
    columns : str
        Names of the columns, with the separator of the file between them: blanks or commas.
    header : bool
        Whether the first line has to be `columns`.

    Returns
    -------
    (N, K) array, N > 0

    Raises
    ------
    SourceError
        Naming the file and the line.
    """
    separator = "," if "," in columns else None
    rows = rows_of_table(path, separator)
    if header and (first := next(rows, (0, [])))[1] != columns.split(separator):
        raise SourceError(f"{path}: the first line must be {columns!r}, got {','.join(first[1])!r}")
    numbers = [_numbers(row, columns, separator, f"{path} line {number}") for number, row in rows]
    if not numbers:
        raise SourceError(f"{path}: no data; expected lines of {columns!r}")
    table = np.array(numbers)
    require_increasing(table[:, 0], str(path))
    return table


def require_increasing(times: Sequence[float] | NDArray[np.float64], where: str) -> None:
    """Raise unless the times are finite seconds and each is later than the one before."""
    values = np.asarray(times, dtype=np.float64)
    if not np.all(np.isfinite(values)):
        raise SourceError(f"{where}: time {int(np.argmin(np.isfinite(values))) + 1} is not finite")
    if len(values) and values.max() > LATEST:
        raise SourceError(f"{where}: {values.max():.9g} is no time in seconds; convert it from finer units")
    backward = np.flatnonzero(np.diff(values) <= 0)
    if len(backward):
        k = int(backward[0])
        raise SourceError(
            f"{where}: times must increase, but {values[k + 1]:.9g} s (row {k + 2}) follows {values[k]:.9g} s"
        )


def _numbers(row: list[str], columns: str, separator: str | None, where: str) -> list[float]:
    expected = len(columns.split(separator))
    if len(row) != expected:
        raise SourceError(f"{where}: expected {expected} values ({columns}), got {len(row)}")
    try:
        values = [float(field) for field in row]
    except ValueError as error:
        hint = "; a line of names begins with #" if row == columns.split(separator) else ""
        raise SourceError(f"{where}: {str(error).rsplit(': ', 1)[-1]} is not a number{hint}") from None
    if not np.all(np.isfinite(values)):
        raise SourceError(f"{where}: a value is not finite")
    return values
