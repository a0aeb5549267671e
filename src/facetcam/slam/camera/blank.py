"""Views that show nothing: covered, blinded, or without a picture."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam.slam.camera.frame import Frame
from facetcam.slam.camera.optics import Optics

_COARSE = 4  # times smaller than the half image: noise is no picture
_LEFT_OUT = 0.05  # of a view's pixels, the darkest and the brightest
_LEAST_CONTRAST = 3  # grey levels between the others: the plainest walls of films have as many


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
            shown = np.sort(coarse[rows, columns])
            few = int(_LEFT_OUT * len(shown))
            blank.append(int(shown[-1 - few]) - int(shown[few]) < _LEAST_CONTRAST)
        frame.blank = np.array(blank) & (not all(blank))
    return frame.blank
