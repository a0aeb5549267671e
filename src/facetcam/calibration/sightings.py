"""What was seen of the boards in the photos."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Sighting:
    """One board seen once, directly or in mirrors, in one photo.

    A board may be sighted several times in one photo, once a view.

    Attributes
    ----------
    photo, board : int
        Indices.
    corners : (N,) int array
        Rows of `Board.points`.
    pixels : (N, 2) array
        Where they are on the raw photo.
    mirrored : bool or None
        Whether the board's image is a mirror image; None where the pattern looks the same in a mirror.
    view : str or None
        Name of the view, once it is known.
    """

    photo: int
    board: int
    corners: NDArray[np.int64]
    pixels: Array
    mirrored: bool | None
    view: str | None = None

    def __len__(self) -> int:
        return len(self.corners)
