"""Following map points from the frame before by optical flow, which reaches farther than their patches."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam.geometry import se3
from facetcam.slam.camera.frame import Frame
from facetcam.slam.camera.optics import Optics
from facetcam.slam.camera.pose import generalized_pose
from facetcam.slam.config import SlamConfig
from facetcam.slam.map.measure import Measurements
from facetcam.slam.tracking.relocaliser import AGREEING

Array = NDArray[np.float64]

_WINDOW = (21, 21)  # px
_ENOUGH = 250  # points for a prediction; of the half-size image they are not good enough
_LEVELS = 3  # of the image pyramid above the first


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
        before.grey,
        frame.grey,
        np.ascontiguousarray(seen.pixels[rows, None], dtype=np.float32),
        np.ascontiguousarray(expected[views, rows, None], dtype=np.float32),
        winSize=_WINDOW,
        maxLevel=_LEVELS,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    pixels = moved[:, 0].astype(np.float64)
    followed = (found[:, 0] > 0) & (optics.view_of(pixels) == views)
    rows, views, pixels = rows[followed], views[followed], pixels[followed]
    plane = optics.plane(pixels, views)
    T, inliers = generalized_pose(xyz[rows], views, plane, optics, 2.0 * config.gate)
    return T if inliers.sum() >= AGREEING else None
