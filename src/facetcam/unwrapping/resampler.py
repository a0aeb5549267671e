"""Bilinear resampling of an image by a fixed map with holes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam import _core
from facetcam.errors import SourceError

Array = NDArray[np.float64]
Image = NDArray[Any]

_FRACTION = 2048  # positions are kept to 1/2048 px, as the kernel reads them
_PIXELS_A_THREAD = 65536  # fewer are done before another thread has started
_TYPES = (np.uint8, np.uint16, np.float32)


class Resampler:
    """Maps from the pixels of one or more pictures to positions on a source image.

    Parameters
    ----------
    pixels : sequence of (H, W, 2) arrays
        Position x, y on the source of every pixel of each picture.
    valid : sequence of (H, W) bool arrays
        False where the picture stays black.
    source_size : tuple of int
        Width and height of the source.
    """

    def __init__(
        self, pixels: Sequence[Array], valid: Sequence[NDArray[np.bool_]], source_size: tuple[int, int]
    ) -> None:
        self.valid = tuple(valid)
        self._source_size = source_size
        positions = [p[v] for p, v in zip(pixels, valid)]
        self._sources = _fixed_point(np.concatenate(positions), source_size)
        self._runs = _runs(np.concatenate([v.ravel() for v in valid]))
        self._ends = np.cumsum([v.size for v in valid])

    def __call__(self, image: Image) -> list[Image]:
        """Resample an image (h, w) or (h, w, 3) of uint8, uint16 or float32 into all pictures.

        Raises
        ------
        SourceError
            If the image has another size or type.
        """
        layers = _layers(image, self._source_size)
        output = np.empty((self._ends[-1], layers.shape[2]), dtype=image.dtype)
        threads = min(cv2.getNumThreads(), len(self._sources) // _PIXELS_A_THREAD)
        _core.remap(self._sources, self._runs, layers, output, max(1, threads))
        parts = np.split(output, self._ends[:-1])
        return [part.reshape(v.shape + image.shape[2:]) for part, v in zip(parts, self.valid)]


def _layers(image: Image, size: tuple[int, int]) -> Image:
    """Return the image as a dense (h, w, channels) array, or raise SourceError if it does not fit."""
    width, height = size
    if image.shape not in ((height, width), (height, width, 1), (height, width, 3)):
        shape = "x".join(map(str, image.shape))
        raise SourceError(
            f"image: the rig's camera gives {height}x{width} or {height}x{width}x3, got {shape}"
        )
    if image.dtype not in _TYPES:
        raise SourceError(f"image: expected uint8, uint16 or float32, got {image.dtype}")
    return np.ascontiguousarray(image).reshape(height, width, -1)


def _fixed_point(pixels: Array, source_size: tuple[int, int]) -> NDArray[np.uint16]:
    """Rows x, y, right, down: a source pixel with right and lower neighbours, and the way towards them."""
    last = np.array(source_size) - 1
    scaled = np.rint(np.clip(pixels, 0, last) * _FRACTION).astype(np.int64)
    corner = np.minimum(scaled // _FRACTION, last - 1)
    return np.hstack([corner, scaled - corner * _FRACTION]).astype(np.uint16)


def _runs(valid: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Runs of valid pixels (begin, end, index of the first among the valid ones) of a flat mask."""
    steps = np.diff(valid.astype(np.int8), prepend=0, append=0)
    begin, end = np.flatnonzero(steps == 1), np.flatnonzero(steps == -1)
    first = np.cumsum(end - begin) - (end - begin)
    return np.stack([begin, end, first], axis=1).astype(np.int32)
