"""Binary descriptors of keypoints: TEBLID, 256 bits, turned by the keypoint's angle.

Source: I. Suarez, J. M. Buenaposada, L. Baumela, "Revisiting binary local image description for
resource limited devices", 2021, https://arxiv.org/abs/2108.08380.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam.features.images import Image, as_grey
from facetcam.features.keypoints import Keypoints

DESCRIPTOR_BYTES = 32
_PATCH_PER_SIZE = 3.5  # 42 pixels for the finest corners: best of 26 to 56 on light, JPEG and viewpoint


def describe(
    image: Image, keypoints: Keypoints, flipped: bool = False
) -> tuple[Keypoints, NDArray[np.uint8]]:
    """Describe keypoints by the patch round them, turned by their angle.

    Parameters
    ----------
    image : (H, W) or (H, W, 3)
        The image in which the keypoints were found.
    keypoints : Keypoints
        Of N points; their angles and sizes are respected.
    flipped : bool
        The points were seen through an odd number of mirrors: the patch is flipped left to right first,
        so that its descriptor equals the one of the same point seen directly.

    Returns
    -------
    Keypoints
        The M <= N points whose patch could be described, unchanged.
    descriptors : (M, 32) uint8
    """
    grey = as_bytes(as_grey(image))
    patches = _mirrored(keypoints, grey.shape[1]) if flipped else keypoints
    if flipped:
        grey = np.ascontiguousarray(grey[:, ::-1])
    points = patches.to_cv2()
    for index, point in enumerate(points):
        point.class_id = index
    teblid = cv2.xfeatures2d.TEBLID.create(_PATCH_PER_SIZE)
    kept, descriptors = teblid.compute(grey, points)
    if descriptors is None:
        return keypoints[:0], np.empty((0, DESCRIPTOR_BYTES), np.uint8)
    return keypoints[np.array([point.class_id for point in kept], np.intp)], descriptors


def as_bytes(grey: Image) -> NDArray[np.uint8]:
    """Stretch the values of other types to 8 bits between their 0.1 % and 99.9 % quantiles."""
    if grey.dtype == np.uint8:
        return np.ascontiguousarray(grey)
    low, high = np.quantile(grey, (0.001, 0.999))
    scaled = (grey.astype(np.float32) - low) * (255.0 / max(high - low, 1e-12))
    stretched: NDArray[np.uint8] = np.clip(scaled + 0.5, 0, 255).astype(np.uint8)
    return stretched


def _mirrored(keypoints: Keypoints, width: int) -> Keypoints:
    """Return the keypoints as they lie in the image flipped left to right."""
    xy = keypoints.xy * np.array([-1, 1], np.float32) + np.array([width - 1, 0], np.float32)
    angle = np.mod(180.0 - keypoints.angle, 360.0).astype(np.float32)
    return Keypoints(xy, keypoints.size, angle, keypoints.response, keypoints.level)
