"""Where images come from: a folder, a film, a ROS bag or a live camera, all read the same way."""

from __future__ import annotations

import math
from collections.abc import Generator
from pathlib import Path
from types import TracebackType
from typing import Self

from facetcam.errors import ConfigError, SourceError
from facetcam.io.frames import Frame, Reader, Skipped
from facetcam.io.image_folder import SUFFIXES, ImageFolder
from facetcam.io.live import LiveCamera
from facetcam.io.prefetch import prefetch
from facetcam.io.ros_bag import Bag, RosBag
from facetcam.io.video import Video

FRAMES_AHEAD = 3


class Source:
    """Frames one by one, decoded in a background thread a few ahead of their use.

    Close it, or use it in a `with` block: leaving ends the thread and frees the file or camera.

    Examples
    --------
    >>> with open_source("film.mp4") as source:     # doctest: +SKIP
    ...     for frame in source:
    ...         print(frame.timestamp, frame.image.shape)
    """

    def __init__(self, reader: Reader) -> None:
        self._reader = reader
        self._frames: Generator[Frame] | None = None

    @property
    def name(self) -> str:
        """Path or camera number, for messages."""
        return self._reader.name

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of every frame."""
        return self._reader.size

    @property
    def count(self) -> int | None:
        """Number of frames as promised by the file, None where unknown."""
        return self._reader.count

    @property
    def time_span(self) -> tuple[float, float] | None:
        """Times of the first and last frame in seconds as promised by the file, None where unknown."""
        return self._reader.time_span

    @property
    def live(self) -> bool:
        """True for a camera, whose frames are dropped where they come too fast."""
        return self._reader.live

    @property
    def skipped(self) -> tuple[Skipped, ...]:
        """Images, or the rest of a film, that could not be read so far."""
        return tuple(self._reader.skipped)

    @property
    def warnings(self) -> tuple[str, ...]:
        """One line for each of `skipped`."""
        return tuple(f"{item.name} skipped: {item.reason}" for item in self.skipped)

    def __iter__(self) -> Generator[Frame]:
        self.close()
        frames = prefetch(self._reader, FRAMES_AHEAD, latest_only=self._reader.live)
        self._frames = frames
        return frames

    def close(self) -> None:
        """End the background thread."""
        if self._frames is not None:
            self._frames.close()
            self._frames = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def open_source(path: Path | str | int, fps: float | None = None, timed: bool = True) -> Source:
    """Open a folder of images, an image, a film, a ROS bag, or a camera by its number.

    Parameters
    ----------
    path : path or int
        A number that is no file's name means a live camera, `BAG:/TOPIC` one of several topics of a bag.
    fps : float, optional
        Frame rate that replaces the source's own times (needed for a folder without `timestamps.txt`).
    timed : bool
        False where times do not matter; then the frames are numbered, one a second.

    Raises
    ------
    SourceError
        If it is missing, empty, damaged from the start, or has no valid times.
    ConfigError
        If `fps` is not a positive number.
    """
    if fps is not None and not (math.isfinite(fps) and fps > 0):
        raise ConfigError(f"--fps {fps}: must be a positive number of frames a second")
    return Source(_reader(path, fps if timed else fps or 1.0))


def _reader(path: Path | str | int, fps: float | None) -> Reader:
    location, bag = Path(str(path)), Bag.at(str(path))
    if bag is not None:
        return RosBag(bag, fps)
    if not location.exists():
        if str(path).isdecimal():
            return LiveCamera(int(str(path)))
        raise SourceError(f"{path}: no such file or folder")
    if location.is_file() and location.stat().st_size == 0:
        raise SourceError(f"{path}: empty file")
    if location.is_dir() or location.suffix.lower() in SUFFIXES:
        return ImageFolder(location, fps)
    return Video(location, fps)
