"""Direction of a keypoint: from it to the intensity centroid of the disc round it, as in ORB."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from facetcam.features.images import Image

_RADIUS = 7


def centroid_angles(grey: Image, xy: NDArray[np.floating]) -> NDArray[np.float32]:
    """Directions in degrees [0, 360) at points (N, 2) of an image (H, W); edge pixels are repeated."""
    v, u = np.mgrid[-_RADIUS : _RADIUS + 1, -_RADIUS : _RADIUS + 1]
    disc = u**2 + v**2 <= _RADIUS * (_RADIUS + 1)
    u, v = u[disc], v[disc]
    column, row = np.rint(xy).astype(np.intp).T
    height, width = grey.shape
    values = grey[
        np.clip(row[:, None] + v, 0, height - 1), np.clip(column[:, None] + u, 0, width - 1)
    ].astype(np.float64)
    degrees = np.degrees(np.arctan2(values @ v, values @ u))
    return np.asarray(np.mod(degrees, 360.0), np.float32)
