"""One frame as tracking uses it: grey pyramid, and corners when they are asked for."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam.errors import FacetcamError
from facetcam.features.descriptors import DESCRIPTOR_BYTES
from facetcam.features.matching import hamming

Image = NDArray[np.uint8]

_ALIKE = 40  # bits by which descriptors of one corner in two frames differ easily
_BESIDE = 6.0  # px within which two corners are one thing


@dataclass(frozen=True, slots=True)
class Corners:
    """Corners of a frame with the view each one is seen through.

    Attributes
    ----------
    pixels : (N, 2) float64 array
    views : (N,) int8 array
    plane : (N, 2) array
        Positions on the views' ideal pinholes.
    descriptors : (N, D) uint8 array
    slide : (N,) bool array
        Those on an edge or a dashed line: where on it they were found says nothing.
    """

    pixels: NDArray[np.float64]
    views: NDArray[np.int8]
    plane: NDArray[np.float64]
    descriptors: NDArray[np.uint8]
    slide: NDArray[np.bool_]

    @classmethod
    def none(cls) -> Corners:
        """No corners."""
        nothing, looks = np.empty((0, 2)), np.empty((0, DESCRIPTOR_BYTES), np.uint8)
        return cls(nothing, np.empty(0, np.int8), nothing, looks, np.empty(0, np.bool_))

    def __len__(self) -> int:
        return len(self.pixels)

    def without(self, rows: NDArray[np.int64]) -> Corners:
        """All but some of them."""
        kept = np.delete(np.arange(len(self)), rows)
        return Corners(
            self.pixels[kept], self.views[kept], self.plane[kept], self.descriptors[kept], self.slide[kept]
        )


@dataclass(slots=True)
class Frame:
    """A raw frame: `grey` at full and `half` at half size, and what else was made of it.

    The image as it came is let go once corners and their `colours` (N, 3), RGB, are taken from it; `blank`
    are the views (V,) that show nothing.
    """

    timestamp: float
    image: NDArray[np.generic] | None
    grey: Image
    half: Image
    corners: Corners | None = field(default=None)
    colours: Image | None = field(default=None)
    blank: NDArray[np.bool_] | None = field(default=None)


def make_frame(image: NDArray[np.generic], timestamp: float, size: tuple[int, int]) -> Frame:
    """Check a raw image of any depth, grey or BGR, and build its grey pyramid.

    Raises
    ------
    FacetcamError
        If its size is not the rig's, or it is neither grey nor colour of 8 or 16 bit.
    """
    if image.dtype not in (np.uint8, np.uint16) or (image.ndim != 2 and image.shape[2:] != (3,)):
        raise FacetcamError(
            f"frame at {timestamp:.3f} s: expected 8 or 16 bit grey or BGR, got {image.dtype} {image.shape}"
        )
    height, width = image.shape[:2]
    if (width, height) != size:
        raise FacetcamError(
            f"frame at {timestamp:.3f} s is {width}x{height}, the rig's camera is {size[0]}x{size[1]}; "
            "use the rig that belongs to this film"
        )
    half = cv2.resize(grey := _grey_bytes(image), None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    return Frame(timestamp, image, grey, half)


def _grey_bytes(image: NDArray[np.generic]) -> Image:
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    if grey.dtype == np.uint16:
        grey = cv2.convertScaleAbs(grey, alpha=1.0 / 257.0)
    return np.ascontiguousarray(grey, dtype=np.uint8)


def repeated(corners: Corners, rows: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Tell which rows of corners another corner of their view looks like."""
    out = np.zeros(len(rows), dtype=bool)
    for view in np.unique(corners.views[rows]):
        own, others = np.flatnonzero(corners.views[rows] == view), np.flatnonzero(corners.views == view)
        alike = hamming(corners.descriptors[rows[own]], corners.descriptors[others]) < _ALIKE
        i, j = np.nonzero(alike)
        apart = np.linalg.norm(corners.pixels[rows[own[i]]] - corners.pixels[others[j]], axis=1) > _BESIDE
        out[own[i[apart]]] = True
    return out
