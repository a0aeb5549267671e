"""One frame as tracking uses it: grey pyramid, and corners when they are asked for."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam.errors import FacetcamError
from facetcam.features import SIICF, Keypoints, describe
from facetcam.features.descriptors import DESCRIPTOR_BYTES
from facetcam.features.matching import hamming
from facetcam.slam.camera.optics import Optics

Image = NDArray[np.uint8]

_ALIKE = 40  # bits by which descriptors of one corner in two frames differ easily
_BESIDE = 6.0  # px within which two corners are one thing
_LEAST_RESPONSE = 0.001  # far below the detector's own: patches and geometry will judge weak corners


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
    """

    pixels: NDArray[np.float64]
    views: NDArray[np.int8]
    plane: NDArray[np.float64]
    descriptors: NDArray[np.uint8]

    @classmethod
    def none(cls) -> Corners:
        """No corners."""
        nothing = np.empty((0, 2))
        return cls(nothing, np.empty(0, np.int8), nothing, np.empty((0, DESCRIPTOR_BYTES), np.uint8))

    def __len__(self) -> int:
        return len(self.pixels)


@dataclass(slots=True)
class Frame:
    """A raw frame: `grey` at full and `half` at half size, and what else was made of it.

    The image as it came is let go once corners and their `colours` (N, 3), RGB, are taken from it.
    """

    timestamp: float
    image: NDArray[np.generic] | None
    grey: Image
    half: Image
    corners: Corners | None = field(default=None)
    colours: Image | None = field(default=None)


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


class Features(Protocol):
    """Finds corners and describes them by 256 bits."""

    def detect(self, image: Image, mask: Image) -> Keypoints:
        """Corners of a grey image (H, W) where the mask is set."""

    def describe(
        self, image: Image, keypoints: Keypoints, flipped: bool
    ) -> tuple[Keypoints, NDArray[np.uint8]]:
        """Descriptors (M, 32) of those keypoints that have one, turned by their angle; see `describe`."""


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


FrontEnd = Callable[[int, int], Features]  # of the number of corners, and of a cell's side in pixels


class SiicfFeatures:
    """The front end: SIICF corners described by TEBLID."""

    def __init__(self, max_features: int, cell: int) -> None:
        self._detector = SIICF.create(
            max_features=max_features, spread=cell, threshold=_LEAST_RESPONSE, oriented=False
        )

    def detect(self, image: Image, mask: Image) -> Keypoints:
        """Corners of an image where the mask is set."""
        return self._detector.detect(image, mask)

    def describe(
        self, image: Image, keypoints: Keypoints, flipped: bool
    ) -> tuple[Keypoints, NDArray[np.uint8]]:
        """Those keypoints that could be described, and their descriptors."""
        return describe(image, keypoints, flipped, "binary")


class CornerFinder:
    """Corners in the valid pixels of all views, with descriptors that know which way is up.

    Which way is up at a pixel is known from the rig, so the turn is taken out of the descriptor, and odd
    chains are described as the mirror images that they are.

    Parameters
    ----------
    optics : Optics
    max_features : int
    front_end : FrontEnd
    """

    def __init__(self, optics: Optics, max_features: int, front_end: FrontEnd = SiicfFeatures) -> None:
        self._optics = optics
        self._one_at_a_time = threading.Lock()  # two threads may ask for the same frame
        # Cells of about nine corners: every part of every view has some, and no blank wall has many.
        cell = int(3 * np.sqrt(np.count_nonzero(optics.mask) / max_features))
        self._features = front_end(max_features, cell)

    def __call__(self, frame: Frame) -> Corners:
        """Corners of the frame, found once and kept with it."""
        with self._one_at_a_time:
            return self._find(frame)

    def _find(self, frame: Frame) -> Corners:
        if frame.corners is None:
            keypoints = self._features.detect(frame.grey, self._optics.mask)
            views = self._optics.view_of(keypoints.xy.astype(np.float64))
            corners = self._describe(frame.grey, keypoints, views)
            frame.colours = colours(frame.grey if frame.image is None else frame.image, corners.pixels)
            frame.corners, frame.image = corners, None
        return frame.corners

    def _describe(self, grey: Image, keypoints: Keypoints, views: NDArray[np.int8]) -> Corners:
        parts = []
        for flipped in (False, True):
            chosen = np.isin(views, np.flatnonzero(self._optics.flipped == flipped))
            if not chosen.any():
                continue
            xy = keypoints.xy[chosen].astype(np.float64)
            roll = self._optics.upright_degrees(xy, views[chosen]).astype(np.float32)
            upright = replace(keypoints[chosen], angle=roll)
            kept, descriptors = self._features.describe(grey, upright, flipped)
            xy = kept.xy.astype(np.float64)
            parts.append((xy, self._optics.view_of(xy), descriptors))
        if not parts:
            return Corners.none()
        pixels, kept_views, descriptors = (np.concatenate(columns) for columns in zip(*parts))
        return Corners(pixels, kept_views, self._optics.plane(pixels, kept_views), descriptors)


def colours(image: NDArray[np.generic], pixels: NDArray[np.float64]) -> NDArray[np.uint8]:
    """RGB (N, 3) of the nearest pixels of a grey or BGR frame."""
    columns, rows = np.rint(pixels).astype(np.int64).T
    values = image[rows, columns]
    if values.dtype == np.uint16:
        values = (values // 257).astype(np.uint8)
    if values.ndim == 1:
        values = np.repeat(values[:, None], 3, axis=1)
    return np.asarray(values[:, ::-1], dtype=np.uint8)
