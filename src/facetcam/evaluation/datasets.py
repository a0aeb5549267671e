"""Image sequences with known homographies: Oxford and HPatches folders, and views that never move."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from facetcam.errors import SourceError
from facetcam.evaluation.repeatability import Points
from facetcam.features.images import Image

_IMAGES = {".png", ".jpg", ".jpeg", ".ppm", ".pgm", ".tif", ".tiff", ".bmp"}


@dataclass(frozen=True, slots=True)
class Sequence:
    """Images of one plane; `homographies[i]` maps the first image to image i + 1.

    Images of a `still` view have no homographies: they must be of one size.
    """

    name: str
    paths: tuple[Path, ...]
    homographies: tuple[Points, ...]
    still: bool = False

    def images(self) -> list[Image]:
        """Read all images as grey uint8; SourceError where one cannot be read or is of another size."""
        images = [read_grey(path) for path in self.paths]
        for path, image in zip(self.paths, images, strict=True):
            if self.still and image.shape != images[0].shape:
                raise SourceError(
                    f"{path}: of another size than {self.paths[0].name}; without homographies "
                    f"({self.paths[0].parent}/H1to2p or H_1_2) the images must show one view"
                )
        return images


def find_sequences(folder: Path) -> Iterator[Sequence]:
    """Find the sequences in a folder: the folder itself, or its subfolders.

    Homographies are read from `H1to2p` (Oxford) or `H_1_2` (HPatches) beside the images. Without any, the
    images are taken to show one view under changing light.

    Raises
    ------
    SourceError
        No folder, fewer than two images, or a homography that is missing or not 3x3.
    """
    if not folder.is_dir():
        reason = "not a folder" if folder.exists() else "does not exist"
        raise SourceError(f"{folder}: {reason}; give a folder of images with homographies")
    own = _image_paths(folder)
    if own:
        yield _sequence(folder, own)
        return
    inner = [sub for sub in sorted(folder.iterdir()) if sub.is_dir() and _image_paths(sub)]
    if not inner:
        raise SourceError(f"{folder}: no images in it or in its subfolders")
    for sub in inner:
        yield _sequence(sub, _image_paths(sub))


def read_grey(path: Path) -> Image:
    """Read an image file as grey uint8; SourceError where it cannot be read."""
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise SourceError(f"{path}: cannot be read as an image; remove or replace it")
    return np.asarray(image)


def _image_paths(folder: Path) -> list[Path]:
    """Image files in natural order: img2 before img10."""
    paths = [path for path in folder.iterdir() if path.suffix.lower() in _IMAGES]
    return sorted(paths, key=lambda path: (len(path.stem), path.stem))


def _sequence(folder: Path, paths: list[Path]) -> Sequence:
    if len(paths) < 2:
        raise SourceError(
            f"{folder}: a sequence needs two images or more, found {len(paths)}; "
            "give the file itself to see it under known changes"
        )
    later = range(2, len(paths) + 1)
    for pattern in ("H1to{}p", "H_1_{}"):
        files = [folder / pattern.format(index) for index in later]
        if any(file.exists() for file in files):
            return Sequence(folder.name, tuple(paths), tuple(_read_homography(file) for file in files))
    return Sequence(folder.name, tuple(paths), tuple(np.eye(3) for _ in later), still=True)


def _read_homography(path: Path) -> Points:
    if not path.exists():
        raise SourceError(f"{path}: missing; every image but the first needs its homography, or none has one")
    try:
        H = np.loadtxt(path)
    except (OSError, ValueError) as error:
        raise SourceError(f"{path}: cannot be read as a homography of 3x3 numbers") from error
    if H.shape != (3, 3) or not np.isfinite(H).all():
        raise SourceError(f"{path}: expected a homography of 3x3 finite numbers, got shape {H.shape}")
    if abs(np.linalg.det(H / np.abs(H).max(initial=1e-300))) < 1e-12:
        raise SourceError(f"{path}: the homography is singular; it must map the first image one to one")
    return H
