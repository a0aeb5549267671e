"""What every source of images has in common."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Frame:
    """One image of a source.

    `image` is (H, W) grey or (H, W, 3) BGR, uint8 or uint16; `timestamp` is in seconds; `name` is the file's
    name, or the number of the frame in six digits.
    """

    index: int
    timestamp: float
    image: NDArray[np.uint8] | NDArray[np.uint16]
    name: str


@dataclass(frozen=True, slots=True)
class Skipped:
    """An image, or the rest of a film, that could not be read, and why."""

    name: str
    reason: str


class Reader(Protocol):
    """Frames in order, read by one thread. Iterating again starts again (but for a live camera)."""

    @property
    def name(self) -> str: ...
    @property
    def size(self) -> tuple[int, int]:
        """Width and height of every frame."""

    @property
    def count(self) -> int | None:
        """Number of frames, as far as the source knows it beforehand."""

    @property
    def time_span(self) -> tuple[float, float] | None:
        """Timestamps of the first and the last frame, as far as the source knows them beforehand."""

    @property
    def skipped(self) -> list[Skipped]:
        """What could not be read so far."""

    @property
    def live(self) -> bool:
        """Whether a late reader should miss frames rather than fall behind."""

    def __iter__(self) -> Iterator[Frame]: ...
