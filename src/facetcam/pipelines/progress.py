"""How a pipeline tells of its progress, and what remains of it when it is cut short."""

from __future__ import annotations

from collections.abc import Callable
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


def reason_of(error: BaseException) -> str:
    """Why a run was cut short, in a few words for its summary."""
    if isinstance(error, KeyboardInterrupt):
        return "stopped by the user"
    return str(error) if isinstance(error, FacetcamError) else f"{type(error).__name__}: {error}"


def say_where(error: BaseException, folder: Path) -> None:
    """Attach to an error where the results so far are."""
    error.add_note(f"the results so far are in {folder}")
