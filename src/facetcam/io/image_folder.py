"""A folder of images, or a single image, as a source."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam.errors import SourceError
from facetcam.io.frames import Frame, Skipped
from facetcam.io.tables import require_increasing, rows_of_table

SUFFIXES = {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp", ".pgm", ".ppm", ".pnm", ".jp2"}
TIMESTAMPS = "timestamps.txt"
# Pixels as they are stored: grey or BGR, 8 or 16 bit, not turned by an EXIF tag.
AS_STORED = cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION


class ImageFolder:
    """Images of a folder in natural order (2.png before 10.png), or in the order of its `timestamps.txt`.

    Parameters
    ----------
    path : Path
        The folder, or one image.
    fps : float, optional
        Frame rate; without it the times come from `timestamps.txt`.

    Raises
    ------
    SourceError
        If there is no readable image, or no valid time for each; while iterating, if sizes differ.
    """

    live = False

    def __init__(self, path: Path, fps: float | None) -> None:
        self.name = str(path)
        self.skipped: list[Skipped] = []
        files = _images_in(path)
        self._files, self._times = _with_times(path, files, fps)
        self.count = len(self._files)
        self.time_span = (self._times[0], self._times[-1])
        self.size = self._first_size()

    def __iter__(self) -> Iterator[Frame]:
        self.skipped.clear()
        for index, (file, timestamp) in enumerate(zip(self._files, self._times)):
            image = self._read(file)
            if image is None:
                continue
            if _size(image) != self.size:
                raise SourceError(
                    f"{file}: {_wxh(_size(image))} pixels but the images before it have"
                    f" {_wxh(self.size)}; remove it or resize it"
                )
            yield Frame(index, timestamp, image, file.name)

    def _first_size(self) -> tuple[int, int]:
        for file in self._files:
            image = self._read(file)
            if image is not None:
                return _size(image)
        first = self.skipped[0]
        raise SourceError(
            f"{self.name}: none of {self.count} images can be read ({first.name}: {first.reason})"
        )

    def _read(self, file: Path) -> NDArray[np.uint8] | NDArray[np.uint16] | None:
        """The image, or None with the reason noted."""
        try:
            return read_image(file)
        except SourceError as error:
            self.skipped.append(Skipped(file.name, str(error).removeprefix(f"{file}: ")))
            return None


def read_image(file: Path) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """Decode one image file as it is stored: (H, W) grey or (H, W, 3) BGR, uint8 or uint16.

    Raises
    ------
    SourceError
        If it is missing, empty, cut off, no image, or of another depth.
    """
    try:
        data = file.read_bytes()
    except OSError as error:
        raise SourceError(f"{file}: {error.strerror}") from error
    if not data:
        raise SourceError(f"{file}: empty file")
    if data.startswith(b"\xff\xd8") and b"\xff\xd9" not in data[-1024:]:
        raise SourceError(f"{file}: cut off")  # OpenCV 4 would fill the rest with grey
    image = cv2.imdecode(np.frombuffer(data, np.uint8), AS_STORED)
    if image is None:
        raise SourceError(f"{file}: damaged or not an image")
    if image.dtype not in (np.uint8, np.uint16):
        raise SourceError(f"{file}: pixels are {image.dtype}, not 8 or 16 bit")
    return np.asarray(image)


def natural_key(path: Path) -> list[tuple[int, str]]:
    """Sort key by which 2.png comes before 10.png."""
    return [
        (int(part), "") if part.isdigit() else (0, part) for part in re.split(r"(\d+)", path.name.lower())
    ]


def _images_in(path: Path) -> list[Path]:
    if path.is_file():
        return [path]
    visible = (f for f in path.iterdir() if f.suffix.lower() in SUFFIXES and not f.name.startswith("."))
    files = sorted(visible, key=natural_key)
    if not files:
        raise SourceError(f"{path}: no images in this folder (known are {' '.join(sorted(SUFFIXES))})")
    return files


def _with_times(path: Path, files: list[Path], fps: float | None) -> tuple[list[Path], Sequence[float]]:
    """Images in the order of their times, with these."""
    table = path / TIMESTAMPS
    if fps is not None or path.is_file():
        return files, [index / (fps or 1.0) for index in range(len(files))]
    if not table.is_file():
        raise SourceError(
            f"{path}: the images have no times; give --fps or write {TIMESTAMPS} (lines: file seconds)"
        )
    return _read_timestamps(table, files)


def _read_timestamps(table: Path, files: list[Path]) -> tuple[list[Path], list[float]]:
    """Lines `file seconds`, or only `seconds`, one for each image in natural order."""
    by_name = {file.name: file for file in files}
    listed: list[Path] = []
    times: list[float] = []
    for number, row in rows_of_table(table):
        if len(row) not in (1, 2):
            raise SourceError(f"{table} line {number}: expected 'file seconds', got {' '.join(row)!r}")
        if len(row) == 2 and row[0] not in by_name:
            raise SourceError(f"{table} line {number}: names {row[0]}, which is not in the folder")
        listed += [by_name[row[0]]] if len(row) == 2 else []
        try:
            times.append(float(row[-1]))
        except ValueError:
            raise SourceError(f"{table} line {number}: {row[-1]!r} is not a number of seconds") from None
    if len(times) != len(files) or len(listed) not in (0, len(files)):
        raise SourceError(f"{table}: {len(times)} times for {len(files)} images; give one for each")
    require_increasing(times, str(table))
    return listed or files, times


def _size(image: NDArray[np.generic]) -> tuple[int, int]:
    return image.shape[1], image.shape[0]


def _wxh(size: tuple[int, int]) -> str:
    return f"{size[0]}x{size[1]}"
