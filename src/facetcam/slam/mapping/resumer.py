"""Going on where nothing of the map is in sight: from where the wheels have carried the rig."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from facetcam.geometry import se3
from facetcam.slam.camera.corner_finder import CornerFinder
from facetcam.slam.camera.frame import Frame
from facetcam.slam.map.map import Keyframe, Map
from facetcam.slam.map.measure import Measurements
from facetcam.slam.mapping.mapper import Mapper
from facetcam.slam.mapping.starter import Starter, least_pairs
from facetcam.slam.relative_pose.confirmed_motion import START_GATE
from facetcam.slam.tracking.fix import Fix
from facetcam.slam.tracking.motion import Start

Array = NDArray[np.float64]

_PATIENCE = 5  # frames in which the map is looked for first


class Resumer:
    """Starts anew beside the map, and carries the start over into it.

    The two parts of the map are joined by the wheels alone until the rig sees the old part again.

    Parameters
    ----------
    starter : Starter
        Of a map of its own, `aside`.
    aside : Map
    map : Map
        To go on with.
    mapper : Mapper
    corners : CornerFinder
    """

    def __init__(self, starter: Starter, aside: Map, map: Map, mapper: Mapper, corners: CornerFinder) -> None:
        self._starter = starter
        self._aside = aside
        self._map = map
        self._mapper = mapper
        self._corners = corners
        self._in_vain = 0  # frames that showed enough, but nothing of the map

    @property
    def in_vain(self) -> bool:
        """Tell whether several frames in a row showed enough, but nothing of the map."""
        return self._in_vain > _PATIENCE

    def offer(self, frame: Frame, odometry: Array | None, wheels_proven: bool) -> Start | None:
        """Take one more frame of a lost rig; returns the start beside the map once there is one."""
        if not self._counts(frame, odometry):
            return None
        return self._starter.offer(frame, odometry, wheels_proven) if self.in_vain else None

    def keep(self, frame: Frame) -> None:
        """Take one more frame of a rig that may be found again yet, for a start by sight later."""
        if self._counts(frame, None):
            self._starter.keep(frame, None)

    def _counts(self, frame: Frame, odometry: Array | None) -> bool:
        """Count a frame that shows enough; one that does not breaks the chain of those before."""
        enough = len(self._corners(frame)) >= least_pairs(odometry)
        if enough:
            self._in_vain += 1
        else:
            self.forget()
        return enough

    def carry_over(self, start: Start, T_world_rig: Array, covariance: Array | None = None) -> Start:
        """Repeat a start in the map, its last frame at a pose of that covariance, or of the world's own."""
        self._map.since = len(self._map.keyframes)
        T_world_aside = T_world_rig @ se3.inverse(start.last.T_world_rig)
        first, last = (self._insert(k, T_world_aside, covariance) for k in (start.first, start.last))
        solved = [(timestamp, _carried(fix, T_world_aside)) for timestamp, fix in start.solved]
        self.forget()
        return Start(first, last, solved, start.T_step, start.step)

    def _insert(self, keyframe: Keyframe, T_world_aside: Array, covariance: Array | None) -> Keyframe:
        assert keyframe.frame is not None
        T_world_rig = T_world_aside @ keyframe.T_world_rig
        own = self._mapper.insert(
            keyframe.frame, T_world_rig, Measurements.none(), keyframe.odometry, START_GATE
        )
        own.covariance = covariance
        own.measured = len(own.observations)
        return own

    def forget(self) -> None:
        """The rig knows where it is."""
        self._in_vain = 0
        self._starter.forget()
        self._aside.clear()


def _carried(fix: Fix, T_world_aside: Array) -> Fix:
    """A fix in another world; the points that it saw are those of the map aside."""
    pose = replace(fix.pose, T_world_rig=T_world_aside @ fix.T_world_rig)
    return replace(fix, pose=pose, seen=Measurements.none())
