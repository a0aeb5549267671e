"""Which poses are believed: all that go on smoothly, only clear or repeated ones after a jump or a loss."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from facetcam.geometry import se3
from facetcam.slam.relative_pose.witnesses import LEAST_IN_VIEW
from facetcam.slam.tracking.fix import Fix

Array = NDArray[np.float64]

_PROBATION = 5  # frames after a loss
_AGAIN = 3  # frames that must find the same pose where none of them is sure
_AGAINST_WHEELS = 6  # and where the wheels say something else
_WITNESSES = 2  # views
_SHARE_IN_VIEW = 0.4  # of what was expected in it, by which a view is a witness by itself
_SAME_METRES = 0.3
_SAME_RADIANS = 0.3
_WHEELS = 0.1  # relative error of way and turn beyond which wheels contradict a pose
_WHEELS_FLOOR = (0.05, 0.05)  # metres, radians
_SLIP = 0.5  # relative error beyond which no slip explains a pose: only a rig that was carried


@dataclass(frozen=True, slots=True)
class Reckoning:
    """Where the wheels have carried a lost rig, and the way (m) and turn (rad) since it was seen last.

    Wheels are `proven` once they have gone as the images did for long enough.
    """

    T_world_rig: Array
    way: float = 0.0
    turn: float = 0.0
    proven: bool = True

    def further(self, T_step: Array) -> Reckoning:
        """After one more step."""
        turn, way = np.linalg.norm(se3.log(T_step).reshape(2, 3), axis=1)
        further = self.T_world_rig @ T_step
        return replace(self, T_world_rig=further, way=self.way + float(way), turn=self.turn + float(turn))

    @property
    def stands(self) -> bool:
        """Tell whether proven wheels have moved by no more than they err."""
        return self.proven and self.way < _WHEELS_FLOOR[0] and self.turn < _WHEELS_FLOOR[1]

    def agrees(self, T_world_rig: Array, share: float = _WHEELS) -> bool:
        """Tell whether a pose is as near as wheels of that relative error would be."""
        turn, way = np.linalg.norm(se3.log(se3.inverse(self.T_world_rig) @ T_world_rig).reshape(2, 3), axis=1)
        return bool(way < _WHEELS_FLOOR[0] + share * self.way and turn < _WHEELS_FLOOR[1] + share * self.turn)


@dataclass(slots=True)
class Trust:
    """Guards against look-alikes: repeated patterns may agree with a wrong pose for a frame or two.

    A pattern that repeats on one wall fools one view, hardly two at once. Each view counts by itself, since a
    wall that hides what the map expects in one says nothing of the others. Wheels bear witness too: a sharp
    pose where they say needs one view less, one elsewhere must be found again and again, and in two views
    where no slip explains it. Wheels not proven yet second nobody, but what they deny needs two views. Where
    no view shows a good part of what it should, nothing makes up for that.
    """

    n_views: int
    _left: int = 0  # frames of probation
    _hope: Array | None = None
    _times: int = 0

    def lose(self) -> None:
        """Doubt the next poses."""
        self._left = _PROBATION

    def believes(
        self, fix: Fix, wheels: Reckoning | None = None, jumps: bool = False, beside: bool = False
    ) -> bool:
        """Tell whether a pose is good enough now; `wheels` tell where a lost rig should be.

        `jumps` says that it is farther from all predictions than a rig could have got, `beside` that the rig
        was lost a moment ago and is found where it was going.
        """
        if not self._left and not jumps:
            return True
        if beside and fix.clear:
            return True
        agreed = wheels is not None and wheels.agrees(fix.T_world_rig)
        seconded = agreed and wheels is not None and wheels.proven and fix.sharp
        witnesses = self._witnesses(fix)
        confirmed = witnesses + int(seconded) >= _WITNESSES
        if not (confirmed or (witnesses and fix.sharp)):
            return False
        self._times = self._times + 1 if self._repeated(fix.T_world_rig) else 1
        self._hope = fix.T_world_rig
        if wheels is None or agreed:
            return confirmed or self._times >= _AGAIN
        if not wheels.proven:
            return confirmed
        borne_out = confirmed or wheels.agrees(fix.T_world_rig, _SLIP)
        return borne_out and self._times >= _AGAINST_WHEELS

    def _witnesses(self, fix: Fix) -> int:
        """Count the views that confirm a pose; the one of a rig with one view does for two."""
        seen, expected = (
            np.bincount(rows.view, minlength=self.n_views) for rows in (fix.seen, fix.predictions)
        )
        confirms = seen >= LEAST_IN_VIEW
        if not (fix.sharp and fix.likely):
            confirms &= (seen >= _SHARE_IN_VIEW * expected) & (self.n_views > 1)
        return int(confirms.sum()) + int(self.n_views == 1 and confirms[0])

    def accept(self) -> None:
        """A pose was believed: sharp ones that go on from it are, too."""
        self._left = max(self._left - 1, 0)
        self._times = max(self._times, _AGAIN)
        if not self._left:
            self._hope, self._times = None, 0

    def _repeated(self, T_world_rig: Array) -> bool:
        if self._hope is None:
            return False
        twist = se3.log(se3.inverse(self._hope) @ T_world_rig)
        near = np.linalg.norm(twist[3:]) < _SAME_METRES and np.linalg.norm(twist[:3]) < _SAME_RADIANS
        return bool(near)
