"""Pictures and their halved copies in one table, for the core."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam.simulation.materials import Picture


def pack_mipmaps(pictures: list[Picture]) -> tuple[Picture, NDArray[np.int32]]:
    """Lay pictures and their halved copies into one table of texels.

    Returns
    -------
    texels : (T, 3) uint8 array
        Square roots of linear reflectance, close to sRGB.
    layout : (N, 4) int32 array
        Offset, width, height and number of levels of each picture.
    """
    texels, layout, offset = [], [], 0
    for picture in pictures:
        levels = _mipmap(picture)
        layout.append((offset, picture.shape[1], picture.shape[0], len(levels)))
        texels += [level.reshape(-1, 3) for level in levels]
        offset += sum(level.shape[0] * level.shape[1] for level in levels)
    return np.concatenate(texels), np.array(layout, dtype=np.int32)


def _mipmap(picture: Picture) -> list[Picture]:
    levels = [picture]
    linear = np.square(picture.astype(np.float32))
    while min(linear.shape[:2]) > 1:
        size = linear.shape[1] // 2, linear.shape[0] // 2
        linear = cv2.resize(linear, size, interpolation=cv2.INTER_AREA)
        levels.append(np.rint(np.sqrt(linear)).astype(np.uint8))
    return levels
