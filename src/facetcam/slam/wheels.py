"""The odometry of a run: taken while nothing is known against it, else taken out of the map again."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from facetcam.slam.odometry.check import OdometryCheck
from facetcam.slam.odometry.planar import checked_odometry
from facetcam.slam.parts import Parts
from facetcam.slam.state import State, Status
from facetcam.slam.threads import Background
from facetcam.slam.tracking.motion import Motion

Array = NDArray[np.float64]


class Wheels:
    """Odometry and what the images say of it.

    Parameters
    ----------
    parts, motion
        Of the system.
    mapping : Background
        Where the map grows.

    Attributes
    ----------
    check : OdometryCheck
    """

    def __init__(self, parts: Parts, motion: Motion, mapping: Background) -> None:
        self._parts = parts
        self._motion = motion
        self._mapping = mapping
        self.check = OdometryCheck()
        self._world = 0  # of the last frame

    def taken(self, odometry: ArrayLike | None) -> Array | None:
        """Odometry of a frame, None once it is refused; raises FacetcamError if it is not three numbers."""
        return None if self.check.complaint else checked_odometry(odometry)

    def compare(self, state: State, wheels: Array | None, map_grows: bool) -> None:
        """Compare a frame with its odometry, and refuse the odometry where they contradict each other."""
        in_one_world, self._world = state.map == self._world, state.map
        tracked = state.T_world_rig if state.status is Status.TRACKING and in_one_world else None
        self.check.offer(state.timestamp, tracked, wheels, self._parts.metric)
        if wheels is not None and self.check.complaint:
            self._refuse(map_grows)

    def conclude(self) -> None:
        """Compare once more at the end, when the scale may be proven that was not before."""
        known = self.check.complaint
        self.check.conclude(self._parts.metric)
        if self.check.complaint != known:
            self._refuse(map_grows=True)
            self._mapping.wait()

    def _refuse(self, map_grows: bool) -> None:
        """Go on by sight alone, and take out of a map that grows what the wheels brought into it."""
        self.replace(lambda _: None)
        if map_grows:
            self._mapping.run(lambda: self._parts.grower.adjust_all(last=True))

    def replace(self, at: Callable[[float], ArrayLike | None]) -> None:
        """Give the keyframes of this run the odometry of another table."""
        self._mapping.wait()
        maps = [self._parts.map, *(left.map for left in self._parts.atlas.left)]
        for keyframe in (k for map in maps for k in map.keyframes):
            if keyframe.session == self._parts.mapper.session:
                keyframe.odometry = checked_odometry(at(keyframe.timestamp))
        self._motion.odometry = None
