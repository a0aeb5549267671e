"""Following map points from the frame before by optical flow, which reaches farther than their patches."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam.geometry import se3
from facetcam.slam.config import SlamConfig
from facetcam.slam.frame import Frame
from facetcam.slam.measure import Measurements
from facetcam.slam.optics import Optics
from facetcam.slam.pose import generalized_pose
from facetcam.slam.relocalisation import AGREEING

Array = NDArray[np.float64]

_WINDOW = (21, 21)  # px
_ENOUGH = 250  # points
_LEVELS = 2  # of the image pyramid above the half-size image, which is enough for a prediction


def pose_by_flow(
    before: Frame,
    seen: Measurements,
    xyz: Array,
    frame: Frame,
    predicted: Array,
    optics: Optics,
    config: SlamConfig,
) -> Array | None:
    """Pose (4, 4) of a frame near a prediction from points (N, 3) that the frame before has `seen`.

    Pyramidal Lucas-Kanade flow begins at the prediction. A jerk moves all of a view by more than a patch can
    bridge, and a poor pose follows the few that agree.
    """
    expected, visible = optics.project(se3.transform(se3.inverse(predicted), xyz))
    rows = np.flatnonzero(visible[seen.view, np.arange(len(seen))])
    if len(rows) < AGREEING:
        return None
    rows = rows[:: -(-len(rows) // _ENOUGH)]
    views = seen.view[rows]
    moved, found, _ = cv2.calcOpticalFlowPyrLK(
        before.half,
        frame.half,
        _on_half_size(seen.pixels[rows]),
        _on_half_size(expected[views, rows]),
        winSize=_WINDOW,
        maxLevel=_LEVELS,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    pixels = 2.0 * moved[:, 0].astype(np.float64) + 0.5
    followed = (found[:, 0] > 0) & (optics.view_of(pixels) == views)
    rows, views, pixels = rows[followed], views[followed], pixels[followed]
    plane = optics.plane(pixels, views)
    T, inliers = generalized_pose(xyz[rows], views, plane, optics, 2.0 * config.gate)
    return T if inliers.sum() >= AGREEING else None


def _on_half_size(pixels: Array) -> NDArray[np.float32]:
    """Pixels (N, 2) on the half-size image, (N, 1, 2): its pixel centres lie between those of pairs."""
    return (0.5 * (pixels[:, None] - 0.5)).astype(np.float32)
