"""Where map points are seen in a frame: predict in every view, then align their patches."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam import _core
from facetcam.geometry import se3
from facetcam.slam.camera.frame import Frame
from facetcam.slam.camera.optics import Optics
from facetcam.slam.config import SlamConfig
from facetcam.slam.map.points import Points

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_ITERATIONS = 12
_MAX_ZOOM = 3.0  # a patch seen this much larger or smaller looks like another one
_MAX_SHEAR = 3.0
_IMAGE_NOISE = 3.0  # grey levels
_MAX_SPREAD = 0.6  # px of expected error beyond which a corner is noise


@dataclass(slots=True)
class Predictions:
    """Map points expected in a frame, one row a (point, view) pair.

    Attributes
    ----------
    point : (M,) ids
    view : (M,) int8
    pixels : (M, 2) expected raw position
    warp : (M, 2, 2) offset on the frame to offset in the point's patch
    """

    point: Index
    view: NDArray[np.int8]
    pixels: Array
    warp: Array

    def __len__(self) -> int:
        return len(self.point)

    def take(self, rows: NDArray[np.generic]) -> Predictions:
        """Some of the rows."""
        return Predictions(self.point[rows], self.view[rows], self.pixels[rows], self.warp[rows])


@dataclass(slots=True)
class Measurements:
    """Map points found in a frame: ids, views, raw pixels, and positions on the ideal pinholes."""

    point: Index
    view: NDArray[np.int8]
    pixels: Array
    plane: Array

    @classmethod
    def none(cls) -> Measurements:
        """Nothing found."""
        return cls(np.empty(0, np.int64), np.empty(0, np.int8), np.empty((0, 2)), np.empty((0, 2)))

    def __len__(self) -> int:
        return len(self.point)

    def take(self, rows: NDArray[np.generic]) -> Measurements:
        """Some of the rows."""
        return Measurements(self.point[rows], self.view[rows], self.pixels[rows], self.plane[rows])


def predict(points: Points, ids: Index, T_world_rig: Array, optics: Optics) -> Predictions:
    """Project map points into every view; a point may leave one mirror and enter another."""
    return predict_at(points.xyz[ids], points.tangent[ids], points, ids, T_world_rig, optics)[0]


def predict_at(
    xyz: Array, tangent: Array, points: Points, ids: Index, T_world_rig: Array, optics: Optics
) -> tuple[Predictions, Index]:
    """Predict map points as if they stood at `xyz` (N, 3) with other tangents (N, 3, 2).

    Returns
    -------
    predictions : Predictions
    rows : (M,) array
        Of `ids`, to which they belong.
    """
    T_rig_world = se3.inverse(T_world_rig)
    points_rig = se3.transform(T_rig_world, xyz)
    pixels, visible = optics.project(points_rig)
    view, rows = np.nonzero(visible)
    jacobian = optics.jacobians(view, points_rig[rows], T_rig_world[:3, :3] @ tangent[rows])
    warp, usable = _warps(points.jacobian[ids[rows]], jacobian)
    seen = Predictions(ids[rows], view.astype(np.int8), pixels[view, rows], warp)
    return seen.take(usable), rows[usable]


def _warps(reference: Array, current: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Affine maps from the frame to the patches, and whether they are mild enough to look alike."""
    a, b, c, d = current[:, 0, 0], current[:, 0, 1], current[:, 1, 0], current[:, 1, 1]
    determinant = a * d - b * c
    safe = np.abs(determinant) > 1e-9
    adjoint = np.stack([np.stack([d, -b], axis=-1), np.stack([-c, a], axis=-1)], axis=-2)
    warp = reference @ (adjoint / np.where(safe, determinant, 1.0)[:, None, None])
    # Singular values from their squares' sum and their product.
    half = 0.5 * np.sum(warp**2, axis=(1, 2))
    product = warp[:, 0, 0] * warp[:, 1, 1] - warp[:, 0, 1] * warp[:, 1, 0]
    largest = np.sqrt(half + np.sqrt(np.maximum(half**2 - product**2, 0.0)))
    smallest = np.abs(product) / np.maximum(largest, 1e-12)
    mild = (largest < _MAX_ZOOM) & (smallest > 1.0 / _MAX_ZOOM) & (largest < _MAX_SHEAR * smallest)
    return warp, safe & mild


def thin(predictions: Predictions, points: Points, per_view: int) -> Predictions:
    """At most `per_view` predictions in each view, those that were found most reliably."""
    success = (points.found[predictions.point] + 1.0) / (points.predicted[predictions.point] + 2.0)
    order = np.lexsort((-predictions.point, -success, predictions.view))
    view = predictions.view[order]
    rank = np.arange(len(order)) - np.searchsorted(view, view)
    return predictions.take(np.sort(order[rank < per_view]))


def measure(
    frame: Frame, predictions: Predictions, points: Points, optics: Optics, config: SlamConfig
) -> tuple[Measurements, NDArray[np.bool_]]:
    """Align the patches of predicted points to the frame.

    Returns
    -------
    measurements : Measurements
        Of the points found.
    found : (M,) bool array
        Which predictions they belong to.
    """
    aligned = _core.align_patches(
        frame.grey,
        frame.half,
        np.ascontiguousarray(points.patch[predictions.point]),
        np.ascontiguousarray(points.offset[predictions.point]),
        np.ascontiguousarray(predictions.warp, dtype=np.float32),
        np.ascontiguousarray(predictions.pixels, dtype=np.float32),
        config.max_shift,
        _ITERATIONS,
        cv2.getNumThreads(),
    )
    pixels = aligned[:, :2].astype(np.float64)
    found = (aligned[:, 2] > config.min_correlation) & (_IMAGE_NOISE * aligned[:, 3] < _MAX_SPREAD)
    found &= optics.view_of(pixels) == predictions.view
    rows = np.flatnonzero(found)
    view = predictions.view[rows]
    return Measurements(predictions.point[rows], view, pixels[rows], optics.plane(pixels[rows], view)), found
