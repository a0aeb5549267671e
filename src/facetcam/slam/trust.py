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
_WITNESSES = 2  # views
_LEAST_IN_VIEW = 5  # measurements without which a view is no witness
_SHARE_IN_VIEW = 0.4  # of what was expected in it, by which a view is a witness by itself
_SAME_METRES = 0.3
_SAME_RADIANS = 0.3


@dataclass(slots=True)
class Trust:
    """Guards against look-alikes: repeated patterns may agree with a wrong pose for a frame or two.

    A pattern that repeats on one wall fools one view, hardly two at once. Each view counts by itself, since a
    wall that hides what the map expects in one says nothing of the others.
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
        sure = self._witnesses(fix) >= _WITNESSES
        if not (sure or fix.sharp):
            return False
        self._times = self._times + 1 if self._repeated(fix.T_world_rig) else 1
        self._hope = fix.T_world_rig
        return sure or self._times >= _AGAIN

    def _witnesses(self, fix: Fix) -> int:
        """Count the views that confirm a pose; the one of a rig with one view does for two."""
        seen, expected = (
            np.bincount(rows.view, minlength=self.n_views) for rows in (fix.seen, fix.predictions)
        )
        confirms = seen >= _LEAST_IN_VIEW
        if not (fix.sharp and fix.likely):
            confirms &= (seen >= _SHARE_IN_VIEW * expected) & (self.n_views > 1)
        return int(confirms.sum()) + int(self.n_views == 1 and confirms[0])

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
