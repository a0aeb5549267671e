"""Corners of a frame, view by view."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from facetcam.features import SIICF, Keypoints, describe
from facetcam.slam.camera.edges import are_corners
from facetcam.slam.camera.frame import Corners, Frame, Image
from facetcam.slam.camera.optics import Optics
from facetcam.slam.camera.patches import cut_patches

_LEAST_RESPONSE = 0.001  # far below the detector's own: patches and geometry will judge weak corners
_AROUND = 32  # px round a view that a detector sees, too
_SAMPLED = 4  # px between those that tell how dark a frame is
_ON_EDGES = 3  # corners in a cell, of those that slide
_GRID = 8  # px: boxes begin where pixels of the coarsest octave do


class Features(Protocol):
    """Finds corners and describes them by 256 bits."""

    def detect(self, image: Image, mask: Image, black: float) -> Keypoints:
        """Corners of a grey image (H, W) where the mask is set; `black` is the grey value of no light."""

    def describe(
        self, image: Image, keypoints: Keypoints, flipped: bool
    ) -> tuple[Keypoints, NDArray[np.uint8]]:
        """Descriptors (M, 32) of those keypoints that have one, turned by their angle; see `describe`."""


FrontEnd = Callable[[int, int], Features]  # of the number of corners, and of a cell's side in pixels


class SiicfFeatures:
    """The front end: SIICF corners described by TEBLID."""

    def __init__(self, max_features: int, cell: int) -> None:
        self._options = SIICF.Options(
            max_features=max_features, spread=cell, threshold=_LEAST_RESPONSE, oriented=False
        )

    def detect(self, image: Image, mask: Image, black: float) -> Keypoints:
        """Corners of an image where the mask is set."""
        return SIICF(replace(self._options, black=black)).detect(image, mask)

    def describe(
        self, image: Image, keypoints: Keypoints, flipped: bool
    ) -> tuple[Keypoints, NDArray[np.uint8]]:
        """Those keypoints that could be described, and their descriptors."""
        return describe(image, keypoints, flipped, "binary")


@dataclass(frozen=True, slots=True)
class Pane:
    """The rows and columns of the frame that show a view, and a mask (H, W) of its valid pixels there."""

    box: tuple[slice, slice]
    mask: Image

    @classmethod
    def of(cls, shown: NDArray[np.bool_]) -> Pane:
        """The pane of the pixels that show a view, with some around them."""
        lines = [np.flatnonzero(shown.any(axis=axis)) for axis in (1, 0)]
        first, last = np.array([(line[0] - _AROUND, line[-1] + 1 + _AROUND) for line in lines]).T
        first, last = _GRID * (np.maximum(first, 0) // _GRID), _GRID * -(-last // _GRID)
        box = slice(first[0], last[0]), slice(first[1], last[1])
        return cls(box, shown[box].view(np.uint8))

    def corners(self, grey: Image, black: float, features: Features) -> Keypoints:
        """Corners of a whole frame in this view, by its own light."""
        found = features.detect(grey[self.box], self.mask, black)
        rows, columns = self.box
        return replace(found, xy=found.xy + np.array([columns.start, rows.start], np.float32))


class CornerFinder:
    """Corners in the valid pixels of all views, with descriptors that know which way is up.

    Which way is up at a pixel is known from the rig, so the turn is taken out of the descriptor, and odd
    chains are described as the mirror images that they are.

    Parameters
    ----------
    optics : Optics
    max_features : int
        Over all views.
    front_end : FrontEnd
    """

    def __init__(self, optics: Optics, max_features: int, front_end: FrontEnd = SiicfFeatures) -> None:
        self._optics = optics
        self._one_at_a_time = threading.Lock()  # two threads may ask for the same frame
        self._most = max_features
        # Cells of about nine corners: every part of every view has some, and no blank wall has many.
        self._cell = int(3 * np.sqrt(np.count_nonzero(optics.mask) / max_features))
        self._features = front_end(max_features, self._cell)
        shown = [optics.labels == view for view in range(optics.n_views)]
        self._panes = [Pane.of(own) for own in shown if own.any()]

    def __call__(self, frame: Frame) -> Corners:
        """Corners of the frame, found once and kept with it."""
        with self._one_at_a_time:
            return self._find(frame)

    def _find(self, frame: Frame) -> Corners:
        if frame.corners is None:
            black = _black_level(frame.grey, self._optics.mask)
            found = Keypoints.joined([p.corners(frame.grey, black, self._features) for p in self._panes])
            views = self._optics.view_of(found.xy.astype(np.float64))
            chosen = _best_of_cells(found, views, self._cell, self._most)
            described = self._describe(frame.grey, found[chosen], views[chosen])
            corners = _few_on_edges(described, self._cell)
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
        patches, offsets, cut = cut_patches(grey, pixels)
        slide = cut & ~are_corners(patches, offsets)
        return Corners(pixels, kept_views, self._optics.plane(pixels, kept_views), descriptors, slide)


def _best_of_cells(found: Keypoints, views: NDArray[np.int8], cell: int, count: int) -> NDArray[np.int64]:
    """Rows of so many keypoints: the best of every cell of every view, then every second best, and so on."""
    best = np.argsort(-found.response, kind="stable")
    rank = _ranks(found.xy[best], views[best], cell)
    return np.asarray(best[np.argsort(rank, kind="stable")[:count]])


def _few_on_edges(corners: Corners, cell: int) -> Corners:
    """The same corners, but of those on edges only the first ones of every cell.

    All those on one line err alike, as it is drawn: many of them are no more witnesses than some.
    """
    slide = np.flatnonzero(corners.slide)
    rank = _ranks(corners.pixels[slide], corners.views[slide], cell)
    return corners.without(slide[rank >= _ON_EDGES])


def _ranks(xy: NDArray[np.floating], views: NDArray[np.int8], cell: int) -> NDArray[np.int64]:
    """How many of the rows before each one (N,) lie in the same cell of the same view."""
    column, row = (xy // cell).astype(np.int64).T
    home = (views.astype(np.int64) << 32) + (row << 16) + column
    order = np.argsort(home, kind="stable")
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order)) - np.searchsorted(home[order], home[order])
    return rank


def _black_level(grey: Image, mask: Image) -> float:
    """Darkest hundredth of a frame's valid pixels: what it calls no light, whichever view shows some."""
    some = grey[::_SAMPLED, ::_SAMPLED][mask[::_SAMPLED, ::_SAMPLED] > 0]
    return float(np.searchsorted(np.cumsum(np.bincount(some)), 0.01 * len(some)))


def colours(image: NDArray[np.generic], pixels: NDArray[np.float64]) -> NDArray[np.uint8]:
    """RGB (N, 3) of the nearest pixels of a grey or BGR frame."""
    columns, rows = np.rint(pixels).astype(np.int64).T
    values = image[rows, columns]
    if values.dtype == np.uint16:
        values = (values // 257).astype(np.uint8)
    if values.ndim == 1:
        values = np.repeat(values[:, None], 3, axis=1)
    return np.asarray(values[:, ::-1], dtype=np.uint8)
