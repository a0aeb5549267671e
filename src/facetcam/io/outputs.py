"""Writing results: into a fresh folder, whole files or none, line by line where a run may be cut short."""

from __future__ import annotations

import errno
import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from facetcam.errors import OutputError


def fresh_folder(path: Path | str) -> Path:
    """Make the folder of one run; one that exists already is refused, so nothing is ever written over.

    Raises
    ------
    OutputError
        If the folder exists or cannot be made.
    """
    folder = Path(path)
    require_absent(folder)
    with writing(folder):
        folder.mkdir(parents=True)
    return folder


class LineWriter:
    """A text file whose lines are on disk as soon as they are written, so that a cut-off run keeps them."""

    def __init__(self, path: Path) -> None:
        self.path = path
        with writing(path):
            self._file = path.open("x", encoding="utf-8", buffering=1)

    def write(self, line: str) -> None:
        """Append one line.

        Raises
        ------
        OutputError
            If it cannot be written; the lines before it stay.
        """
        with writing(self.path):
            self._file.write(line + "\n")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with suppress(OSError):  # a full disk has been said by the line that met it
            self._file.close()


def atomic_write(path: Path, data: bytes | str) -> None:
    """Write a whole file; on failure, or when killed, the file that was there before stays as it was.

    Raises
    ------
    OutputError
        If it cannot be written.
    """
    content = data.encode() if isinstance(data, str) else data
    with writing(path):
        descriptor, temporary = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
        try:
            with os.fdopen(descriptor, "wb") as file:
                file.write(content)
                file.flush()
                os.fsync(descriptor)
            Path(temporary).chmod(0o666 & ~_umask())
            Path(temporary).replace(path)
        except BaseException:
            Path(temporary).unlink(missing_ok=True)
            raise


def require_absent(path: Path | str) -> None:
    """Raise OutputError if the path of a future output folder is taken, or no folder can be made there."""
    with writing(Path(path)):
        if Path(path).exists():
            raise OutputError(f"{path}: exists already and is not written over; choose another --out")
        parent = next(p for p in Path(path).absolute().parents if p.exists())
    if not parent.is_dir() or not os.access(parent, os.W_OK | os.X_OK):
        reason = os.strerror(errno.EACCES if parent.is_dir() else errno.ENOTDIR)
        raise OutputError(f"{path}: cannot be written ({reason}: {parent})")


@contextmanager
def each_tried() -> Iterator[Callable[[Callable[[], object]], object]]:
    """Hand out what calls a function and lets others be tried where it raises OutputError, told at the end.

    What still fits on a full disk is worth having.
    """
    failures: list[OutputError] = []

    def tried(write: Callable[[], object]) -> object:
        try:
            return write()
        except OutputError as error:
            failures.append(error)
            return None

    yield tried
    if failures:
        raise failures[0]


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn the system's complaint about a file into an OutputError."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error)
        raise OutputError(f"{path}: cannot be written ({reason})") from error


def _umask() -> int:
    """The process's mask for new files, which `mkstemp` ignores; the system only tells it by setting it."""
    mask = os.umask(0)
    os.umask(mask)
    return mask
