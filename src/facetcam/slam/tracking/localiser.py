"""From frame to frame in the map: predicted, found, believed, and looked at twice where it would grow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from facetcam.slam.camera.frame import Frame
from facetcam.slam.config import SlamConfig
from facetcam.slam.map.map import Keyframe, Map
from facetcam.slam.tracking.fix import Fix
from facetcam.slam.tracking.fusion import contradict, fused
from facetcam.slam.tracking.keyframes import is_due, nearest_keyframe
from facetcam.slam.tracking.motion import Motion
from facetcam.slam.tracking.tracker import Tracker
from facetcam.slam.tracking.trust import Trust

Array = NDArray[np.float64]


class Localiser:
    """Tells which pose of a frame counts.

    Parameters
    ----------
    map, tracker, motion, config
        The parts of the system.
    n_views : int
    """

    def __init__(self, map: Map, tracker: Tracker, motion: Motion, config: SlamConfig, n_views: int) -> None:
        self._map = map
        self._tracker = tracker
        self._motion = motion
        self._config = config
        self._n_views = n_views
        self.trust_again()

    def trust_again(self) -> None:
        """Believe poses that go on smoothly, as where the map has just begun or goes on."""
        self._trust = Trust(self._n_views)

    def doubt(self) -> None:
        """Believe only what is clear, or found again: the rig was lost, or never seen in this map yet."""
        self._trust.lose()

    def find(self, frame: Frame, odometry: Array | None, by_wheels: bool, grows: bool) -> Fix | None:
        """A pose of a frame that can be believed, if there is one.

        `by_wheels` tells that odometry foretells it best, `grows` that a keyframe may be made of it.
        """
        predictions, velocity = self._motion.predictions(frame.timestamp, odometry), self._motion.velocity
        likeliest = predictions if by_wheels else predictions[::-1]
        fix = self._tracker.find(frame, *likeliest, velocity=velocity)
        if fix is None and likeliest and not self._motion.lost_frames:
            fix = self._tracker.held(frame, likeliest[0], velocity)
        if fix is None:
            return None
        jumps = self._motion.jumps(frame.timestamp, fix.T_world_rig, predictions)
        beside = self._motion.is_beside(frame.timestamp, fix.T_world_rig, predictions)
        if not self._trust.believes(fix, self._motion.reckoned(odometry), jumps, beside):
            return None
        told = self._motion.told(odometry, self._config.odometry_sigma)
        if told is not None:
            fix = replace(fix, pose=fused(fix.pose, *told))
        if fix.sure or not grows or not is_due(fix, *self._nearest(fix), self._config):
            return fix
        return self._second_look(frame, fix, velocity, told if by_wheels else None)

    def _second_look(
        self, frame: Frame, fix: Fix, velocity: Array, told: tuple[Array, Array] | None
    ) -> Fix | None:
        """An unsure pose of a keyframe to be, as the corners of the last one leave it, or put it right.

        Corners look alike elsewhere, too: no pose is put where wheels, if they have `told`, cannot have come.
        """
        confirmed = self._tracker.confirmed(frame, fix, velocity)
        if confirmed is None and self._map.young:
            return fix  # the whole map is doubted then
        if confirmed is not None and told is not None and contradict(confirmed.pose, *told):
            return fix
        if confirmed is not fix:
            self._motion.go_back(self._map.keyframes[-1])
        return confirmed

    def accept(self, frame: Frame, fix: Fix, odometry: Array | None) -> bool:
        """Go on from a pose; tells whether a keyframe is due."""
        self._tracker.record(frame, fix)
        nearest, distance = self._nearest(fix)
        self._motion.follow(frame.timestamp, fix, nearest, odometry)
        self._trust.accept()
        return is_due(fix, nearest, distance, self._config)

    def _nearest(self, fix: Fix) -> tuple[Keyframe, float]:
        return nearest_keyframe(self._map, fix, self._config)
