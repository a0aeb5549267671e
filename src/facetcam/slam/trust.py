"""Which poses are believed: all while tracking, only clear or repeated ones after a loss."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from facetcam.geometry import se3
from facetcam.slam.tracking import Fix

Array = NDArray[np.float64]

_PROBATION = 5  # frames after a loss
_AGAIN = 3  # frames that must find the same pose where none of them is sure
_LEAST_IN_VIEW = 5  # measurements by which a view confirms a pose
_SAME_METRES = 0.3
_SAME_RADIANS = 0.3


@dataclass(slots=True)
class Trust:
    """Guards against look-alikes: repeated patterns may agree with a wrong pose for a frame or two.

    A pattern that repeats on one wall fools one view, hardly two at once.
    """

    n_views: int
    _left: int = 0  # frames of probation
    _hope: Array | None = None
    _times: int = 0

    def lose(self) -> None:
        """Doubt the next poses."""
        self._left = _PROBATION

    def believes(self, fix: Fix) -> bool:
        """Tell whether a pose is good enough now."""
        if not self._left:
            return True
        if not fix.sharp:
            return False
        self._times = self._times + 1 if self._repeated(fix.T_world_rig) else 1
        self._hope = fix.T_world_rig
        views = np.bincount(fix.seen.view, minlength=self.n_views)
        several = np.count_nonzero(views >= _LEAST_IN_VIEW) >= min(self.n_views, 2)
        return bool((fix.likely and several) or self._times >= _AGAIN)

    def accept(self) -> None:
        """A pose was believed."""
        self._left = max(self._left - 1, 0)
        if not self._left:
            self._hope, self._times = None, 0

    def _repeated(self, T_world_rig: Array) -> bool:
        if self._hope is None:
            return False
        twist = se3.log(se3.inverse(self._hope) @ T_world_rig)
        near = np.linalg.norm(twist[3:]) < _SAME_METRES and np.linalg.norm(twist[:3]) < _SAME_RADIANS
        return bool(near)
