"""Pixels of ROS image messages (sensor_msgs/Image, sensor_msgs/CompressedImage)."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam.errors import SourceError
from facetcam.io.image_folder import AS_STORED

# Bytes a number, numbers a pixel, and how OpenCV makes BGR of them. ROS names a Bayer pattern by its first
# two rows from the corner, OpenCV by the second row from the second pixel.
_ENCODINGS: dict[str, tuple[int, int, int | None]] = {
    "mono8": (1, 1, None),
    "8UC1": (1, 1, None),
    "mono16": (2, 1, None),
    "16UC1": (2, 1, None),
    "bgr8": (1, 3, None),
    "8UC3": (1, 3, None),
    "bgr16": (2, 3, None),
    "rgb8": (1, 3, cv2.COLOR_RGB2BGR),
    "rgb16": (2, 3, cv2.COLOR_RGB2BGR),
    "bgra8": (1, 4, cv2.COLOR_BGRA2BGR),
    "8UC4": (1, 4, cv2.COLOR_BGRA2BGR),
    "rgba8": (1, 4, cv2.COLOR_RGBA2BGR),
    "bayer_rggb8": (1, 1, cv2.COLOR_BayerBG2BGR),
    "bayer_bggr8": (1, 1, cv2.COLOR_BayerRG2BGR),
    "bayer_gbrg8": (1, 1, cv2.COLOR_BayerGR2BGR),
    "bayer_grbg8": (1, 1, cv2.COLOR_BayerGB2BGR),
    "bayer_rggb16": (2, 1, cv2.COLOR_BayerBG2BGR),
    "bayer_bggr16": (2, 1, cv2.COLOR_BayerRG2BGR),
    "bayer_gbrg16": (2, 1, cv2.COLOR_BayerGR2BGR),
    "bayer_grbg16": (2, 1, cv2.COLOR_BayerGB2BGR),
    "yuv422": (1, 2, cv2.COLOR_YUV2BGR_UYVY),
    "uyvy": (1, 2, cv2.COLOR_YUV2BGR_UYVY),
    "yuv422_yuy2": (1, 2, cv2.COLOR_YUV2BGR_YUY2),
    "yuyv": (1, 2, cv2.COLOR_YUV2BGR_YUY2),
}


def pixels(message: Any) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """Image of a message: (H, W) grey or (H, W, 3) BGR, uint8 or uint16; SourceError if it cannot be read."""
    return _raw(message) if hasattr(message, "encoding") else _compressed(message)


def _compressed(message: Any) -> NDArray[np.uint8] | NDArray[np.uint16]:
    data = np.frombuffer(message.data, np.uint8)
    image = cv2.imdecode(data, AS_STORED) if len(data) else None
    if image is None or image.dtype not in (np.uint8, np.uint16):
        raise SourceError(f"damaged, or no image (format {message.format!r})")
    return np.asarray(image)


def _raw(message: Any) -> NDArray[np.uint8] | NDArray[np.uint16]:
    if message.encoding not in _ENCODINGS:
        known = ", ".join(_ENCODINGS)
        raise SourceError(f"its encoding {message.encoding!r} is none of {known}")
    width, channels, conversion = _ENCODINGS[message.encoding]
    rows = np.frombuffer(message.data, np.uint8)
    row = message.width * channels * width
    if not message.height or not row or message.step < row or len(rows) != message.height * message.step:
        raise SourceError(
            f"{len(rows)} bytes are no {message.width}x{message.height} pixels of {message.encoding}"
            f" in rows of {message.step}"
        )
    order = ">" if message.is_bigendian else "<"
    packed = np.ascontiguousarray(rows.reshape(message.height, message.step)[:, :row])
    shape = (message.height, message.width) + ((channels,) if channels > 1 else ())
    image = packed.view(f"{order}u{width}").astype(f"u{width}").reshape(shape)
    return image if conversion is None else np.asarray(cv2.cvtColor(image, conversion))
