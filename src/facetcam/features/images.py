"""What a detector accepts as an image and as a mask."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam.errors import FacetcamError

Image = NDArray[Any]
Mask = NDArray[np.uint8]

_DTYPES = (np.uint8, np.uint16, np.float32, np.float64)


def as_grey(image: Image) -> Image:
    """Check an image and make it grey.

    Parameters
    ----------
    image : (H, W) or (H, W, 1 | 3 | 4) uint8, uint16, float32 or float64
        Any strides; three channels are BGR, the fourth is dropped.

    Returns
    -------
    (H, W) uint8, uint16 or float32

    Raises
    ------
    FacetcamError
        Wrong type or shape, no pixel, or a pixel that is not finite.
    """
    if not isinstance(image, np.ndarray) or image.dtype.type not in _DTYPES:
        got = image.dtype if isinstance(image, np.ndarray) else type(image).__name__
        raise FacetcamError(f"image: expected an array of uint8, uint16, float32 or float64, got {got}")
    if image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] not in (1, 3, 4)):
        raise FacetcamError(f"image: expected shape (H, W) or (H, W, 1, 3 or 4), got {image.shape}")
    if image.size == 0:
        raise FacetcamError(f"image: expected at least one pixel, got shape {image.shape}")
    image = image.astype(image.dtype.newbyteorder("="), copy=False)
    if image.dtype.kind == "f":
        with np.errstate(over="ignore"):  # told in the next line
            image = image.astype(np.float32, copy=False)
        if not np.isfinite(image).all():
            raise FacetcamError(
                "image: has pixels that are NaN, infinite or beyond float32; replace them first"
            )
    if image.ndim == 2:
        return image
    if image.shape[2] == 1:
        return image[:, :, 0]
    return np.asarray(cv2.cvtColor(np.ascontiguousarray(image[:, :, :3]), cv2.COLOR_BGR2GRAY))


def as_mask(mask: Image | None, shape: tuple[int, ...]) -> Mask | None:
    """Check a mask (H, W) uint8 or bool against the image; nonzero pixels may hold points."""
    if mask is None:
        return None
    if not isinstance(mask, np.ndarray) or mask.dtype not in (np.uint8, np.bool_):
        got = mask.dtype if isinstance(mask, np.ndarray) else type(mask).__name__
        raise FacetcamError(f"mask: expected an array of uint8 or bool, got {got}")
    if mask.shape != shape[:2]:
        raise FacetcamError(f"mask: expected the shape of the image {shape[:2]}, got {mask.shape}")
    return mask.view(np.uint8)
