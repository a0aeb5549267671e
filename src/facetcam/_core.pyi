"""Native kernels of facetcam."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

def detect_corners(
    image: NDArray[Any],
    mask: NDArray[np.uint8] | None,
    table: NDArray[np.float32],
    levels: NDArray[np.float32],
    alpha: float,
    compression: float,
    floor: float,
    suppression: int,
    cross_scale: float,
    max_features: int,
    cell: int,
    border: int,
    oriented: bool,
    threads: int,
    isa: int = -1,
) -> NDArray[np.float32]: ...
def transfer_table(
    image: NDArray[Any], mask: NDArray[np.uint8] | None, eta: float
) -> NDArray[np.float32]: ...
def best_isa() -> int: ...
def match_mutual(
    query: NDArray[np.uint8], train: NDArray[np.uint8], max_distance: int, ratio: float
) -> NDArray[np.int32]: ...
def match_windowed(
    query: NDArray[np.uint8],
    query_xy: NDArray[np.float32],
    query_view: NDArray[np.int32],
    train: NDArray[np.uint8],
    train_xy: NDArray[np.float32],
    train_view: NDArray[np.int32],
    radius: float,
    max_distance: int,
    ratio: float,
) -> NDArray[np.int32]: ...
