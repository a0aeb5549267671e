"""Photos of boards: read and looked at on all cores, and remembered, so that a second run takes no time."""

from __future__ import annotations

import hashlib
import os
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from itertools import islice
from pathlib import Path
from threading import Lock

import numpy as np
from numpy.typing import NDArray

from facetcam.calibration.boards import BoardSet
from facetcam.calibration.detection import detect, refine, to_grey
from facetcam.calibration.sharpness import blur_of
from facetcam.errors import FacetcamError, SourceError
from facetcam.io.image_folder import SUFFIXES, natural_key, read_image
from facetcam.pipelines.photo_memory import Photo, key, recall, remember
from facetcam.pipelines.progress import Progress, silent
from facetcam.viz.wording import plural

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

KEPT_IMAGES = 4  # of the second look
UNREAD = {".heic", ".heif", ".avif", ".gif", ".dng", ".cr2", ".cr3", ".nef", ".arw", ".raf", ".orf", ".rw2"}
FILMS = {".mp4", ".mov", ".avi", ".mkv", ".webm", ".m4v", ".3gp", ".mts"}


def photo_paths(images: Path | str | Sequence[Path | str]) -> list[Path]:
    """The photos of a folder in natural order, or those listed.

    Raises
    ------
    SourceError
        If there is none, one is missing or a film, or the folder cannot be read.
    """
    if isinstance(images, (str, Path)):
        try:
            return _photos_in(Path(images))
        except OSError as error:
            raise SourceError(f"{images}: cannot be read ({error.strerror or error})") from error
    paths = [Path(image) for image in images]
    missing = [path for path in paths if not path.is_file()]
    if missing or not paths:
        raise SourceError(f"{missing[0]}: no such photo" if missing else "photos: none given")
    return paths


def _photos_in(folder: Path) -> list[Path]:
    if not folder.exists():
        raise SourceError(f"{folder}: no such folder of photos")
    if folder.is_file():
        if folder.suffix.lower() in UNREAD | FILMS:
            raise SourceError(f"{folder}: {_remedy(folder)}")
        return [folder]
    paths = _files_in(folder, SUFFIXES)
    if not paths:
        others = _files_in(folder, UNREAD | FILMS)
        hint = f"; {others[0].name}: {_remedy(others[0])}" if others else ""
        known = " ".join(sorted(SUFFIXES))
        raise SourceError(f"{folder}: no photos in this folder (known are {known}){hint}")
    return paths


def _files_in(folder: Path, suffixes: set[str]) -> list[Path]:
    """Visible files with one of the suffixes, in natural order."""
    found = (f for f in folder.iterdir() if f.suffix.lower() in suffixes and not f.name.startswith("."))
    return sorted((f for f in found if f.is_file()), key=natural_key)


def _remedy(file: Path) -> str:
    if file.suffix.lower() in FILMS:
        return "a film; save frames of it as PNG, of moments in which nothing moves"
    return f"{file.suffix} photos are not read; save them as JPEG or PNG of the same size"


def passed_over(images: Path | str | Sequence[Path | str]) -> list[str]:
    """Files of the folder that hold pictures but are not read, in a line; none if there are none."""
    folder = Path(images) if isinstance(images, (str, Path)) else None
    if folder is None or not folder.is_dir():
        return []
    others = _files_in(folder, UNREAD | FILMS)
    if not others:
        return []
    count = plural(len(others), "file")
    return [f"{folder}: {count} passed over, such as {others[0].name}: {_remedy(others[0])}"]


def look_at_photos(
    paths: Sequence[Path], boards: BoardSet, cache: Path | None = None, progress: Progress = silent
) -> tuple[list[Photo], list[str]]:
    """Find the boards in all photos, several at a time; few images are in memory at once.

    Parameters
    ----------
    paths : sequence of Path
    boards : BoardSet
    cache : Path, optional
        Folder in which what was found is kept photo by photo; a run cut short takes it up again.
    progress : callable
        Called with photos done and photos in all.

    Returns
    -------
    photos : list of Photo
        Their sightings' `photo` is the place in this list.
    unreadable : list of str
        One line for each photo that could not be read.

    Raises
    ------
    SourceError
        If none can be read.
    """
    photos: list[Photo] = []
    unreadable: list[str] = []
    for done, outcome in enumerate(_looked(paths, boards, cache), start=1):
        if isinstance(outcome, Photo):
            own = tuple(replace(s, photo=len(photos)) for s in outcome.sightings)
            photos.append(replace(outcome, sightings=own))
        else:
            unreadable.append(outcome)
        progress(done, len(paths))
    if not photos:
        raise SourceError(f"photos: none of {len(paths)} can be read ({unreadable[0]})")
    return photos, unreadable


def _looked(paths: Sequence[Path], boards: BoardSet, cache: Path | None) -> Iterator[Photo | str]:
    """Outcomes in the order of the photos, a few ahead of who asks."""
    workers = os.cpu_count() or 1
    rest = iter(paths)
    with ThreadPoolExecutor(workers) as pool:
        waiting: list[Future[Photo | str]] = []
        try:
            while True:
                ahead = islice(rest, 2 * workers - len(waiting))
                waiting += [pool.submit(_look_at, path, boards, cache) for path in ahead]
                if not waiting:
                    return
                yield waiting.pop(0).result()
        finally:
            for future in waiting:
                future.cancel()


def _look_at(path: Path, boards: BoardSet, cache: Path | None) -> Photo | str:
    try:
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        remembered = cache / f"{key(digest, boards)}.npz" if cache is not None else None
        known = recall(remembered, path, digest)
        if known is not None:
            return known
        image = read_image(path)
    except OSError as error:
        return f"{path}: {error.strerror}"
    except FacetcamError as error:
        return str(error)
    sightings = tuple(detect(image, boards))
    corners = np.concatenate([s.pixels for s in sightings]) if sightings else np.empty((0, 2))
    size = image.shape[1], image.shape[0]
    photo = Photo(path, size, digest, camera_of(path), blur_of(to_grey(image), corners), sightings)
    remember(remembered, photo)
    return photo


def camera_of(path: Path) -> str:
    """Maker, model and focal length in the file's EXIF; empty where there are none."""
    from PIL import Image as Pictures

    try:
        with Pictures.open(path) as picture:
            exif = picture.getexif()
        named = [str(exif.get(tag, "")).strip("\x00 ") for tag in (0x010F, 0x0110)]
        focal = exif.get_ifd(0x8769).get(0x920A)
    except Exception:  # a broken tag tells nothing
        return ""
    words = " ".join(word for word in named if word)
    return f"{words} {float(focal):g} mm".strip() if focal else words


class SecondLook:
    """Looks for corners of photos where they are predicted; reads a photo again when it is asked for."""

    def __init__(self, photos: Sequence[Photo]) -> None:
        self._photos = photos
        self._images: OrderedDict[int, Image] = OrderedDict()
        self._lock = Lock()

    def __call__(self, photo: int, predicted: Array, square_px: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Pixels (N, 2) of corners near `predicted`, and whether (N,) one is there."""
        return refine(self.image(photo), predicted, square_px)

    def image(self, photo: int) -> Image:
        """The grey image of a photo."""
        with self._lock:
            if photo in self._images:
                self._images.move_to_end(photo)
            else:
                self._images[photo] = to_grey(read_image(self._photos[photo].path))
                while len(self._images) > KEPT_IMAGES:
                    self._images.popitem(last=False)
            return self._images[photo]
