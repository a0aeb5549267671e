"""Photographs for a report: points drawn in the colour of their view, embedded as JPEG."""

from __future__ import annotations

import base64

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam.viz.palette import view_bgr

JPEG_QUALITY = 82
CAPTION_HEIGHT = 30  # pixels


def to_bgr8(image: NDArray[np.generic]) -> NDArray[np.uint8]:
    """A grey or BGR image of 8 or 16 bit as a fresh BGR image of 8 bit."""
    values = np.asarray(image)
    if values.dtype == np.uint16:
        values = values >> 8
    bgr = values.astype(np.uint8)
    return cv2.cvtColor(bgr, cv2.COLOR_GRAY2BGR) if bgr.ndim == 2 else bgr.copy()


def draw_points(
    image: NDArray[np.generic], points: NDArray[np.floating], views: NDArray[np.integer], width: int
) -> NDArray[np.uint8]:
    """Shrink `image` to at most `width` pixels and draw `points` (N, 2), in its pixels, in view colours."""
    bgr = to_bgr8(image)
    scale = min(1.0, width / bgr.shape[1])
    small = cv2.resize(bgr, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) if scale < 1.0 else bgr
    for (x, y), view in zip(points, views, strict=True):
        # OpenCV's sub-pixel drawing: coordinates in 1/16 pixel, pixel centres at whole numbers.
        centre = tuple(round(16 * ((float(c) + 0.5) * scale - 0.5)) for c in (x, y))
        cv2.circle(small, centre, 16 * 3 + 8, (0, 0, 0), 3, cv2.LINE_AA, shift=4)
        cv2.circle(small, centre, 16 * 3 + 8, view_bgr(int(view)), 2, cv2.LINE_AA, shift=4)
    return np.asarray(small, np.uint8)


def captioned(picture: NDArray[np.uint8], caption: str) -> NDArray[np.uint8]:
    """The BGR picture under a strip with words, in a white frame."""
    strip = np.full((CAPTION_HEIGHT, picture.shape[1], 3), 255, np.uint8)
    place = (4, CAPTION_HEIGHT - 9)
    cv2.putText(strip, caption, place, cv2.FONT_HERSHEY_SIMPLEX, 0.6, (36, 31, 27), 1, cv2.LINE_AA)
    framed = cv2.copyMakeBorder(
        np.vstack([strip, picture]), 0, 6, 6, 6, cv2.BORDER_CONSTANT, value=(255,) * 3
    )
    return np.asarray(framed, np.uint8)


def data_uri(image: NDArray[np.uint8]) -> str:
    """The image as a `data:` address, so that a page needs no file beside it."""
    _, jpeg = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return "data:image/jpeg;base64," + base64.b64encode(jpeg.tobytes()).decode()
