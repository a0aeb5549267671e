"""How a pipeline tells of its progress, and what remains of it when it is cut short."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from facetcam.errors import FacetcamError

Progress = Callable[[int, int | None], None]
"""Called after each frame with the number of frames done and of all frames, None where unknown.

What it raises ends the run between two frames; the results so far are kept.
"""


def silent(done: int, total: int | None) -> None:
    """Progress that nobody watches."""


def total_frames(count: int | None, max_frames: int | None) -> int | None:
    """How many frames will be read at most."""
    known = [n for n in (count, max_frames) if n is not None]
    return min(known) if known else None


@contextmanager
def keeping(folder: Path, finish: Callable[[str], object]) -> Iterator[None]:
    """However the block is cut short, Ctrl-C included: finish what is there and say where it is.

    Parameters
    ----------
    folder : Path
        Where the results are.
    finish : callable
        Called with the reason in a few words.
    """
    try:
        yield
    except BaseException as error:
        with suppress(Exception):  # the first error is the one to tell
            finish(reason_of(error))
        error.add_note(f"the results so far are in {folder}")
        raise


def reason_of(error: BaseException) -> str:
    """Why a run was cut short."""
    if isinstance(error, KeyboardInterrupt):
        return "stopped by the user"
    return str(error) if isinstance(error, FacetcamError) else f"{type(error).__name__}: {error}"
