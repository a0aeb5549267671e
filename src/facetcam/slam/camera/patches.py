"""Cut-outs of frames round their corners."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

PATCH_SIZE = 39


def cut_patches(
    grey: NDArray[np.uint8], pixels: Array
) -> tuple[NDArray[np.uint8], NDArray[np.float32], NDArray[np.bool_]]:
    """Square patches (N, P, P) round pixels (N, 2), the features' offsets, and which lie on the frame."""
    half = PATCH_SIZE // 2
    centre = np.rint(pixels).astype(np.int64)
    height, width = grey.shape
    kept = np.all((centre >= half) & (centre < (width - half, height - half)), axis=1)
    windows = np.lib.stride_tricks.sliding_window_view(grey, (PATCH_SIZE, PATCH_SIZE))
    corner = np.where(kept[:, None], centre - half, 0)
    return windows[corner[:, 1], corner[:, 0]], (pixels - centre).astype(np.float32), kept
