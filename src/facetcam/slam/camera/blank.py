"""Views that show nothing: covered, blinded, or without a picture."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam.slam.camera.frame import Frame
from facetcam.slam.camera.optics import Optics

_COARSE = 4  # times smaller than the half image: noise is no picture
_PERCENTILES = (5, 95)
_LEAST_CONTRAST = 2.5  # grey levels between these: the plainest walls of films have three and more


def blank_views(frame: Frame, optics: Optics) -> NDArray[np.bool_]:
    """Views (V,) that are of one grey all over: they neither bear out what should be there nor deny it.

    There is none where all are: then the light is gone, and the map is still there.
    """
    if frame.blank is None:
        scale = 1.0 / _COARSE
        coarse = cv2.resize(frame.half, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        last = np.array(coarse.shape) - 1
        blank = []
        for pixels in optics.samples:
            columns, rows = np.minimum(pixels // (2 * _COARSE), last[::-1]).T
            blank.append(np.ptp(np.percentile(coarse[rows, columns], _PERCENTILES)) < _LEAST_CONTRAST)
        frame.blank = np.array(blank) & (not all(blank))
    return frame.blank
