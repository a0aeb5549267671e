"""The map while it grows: keyframes, loops, and when all of it is adjusted and its scale judged."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from facetcam.slam.adjustment.adjuster import Adjuster
from facetcam.slam.camera.frame import Corners, Frame
from facetcam.slam.camera.optics import Optics
from facetcam.slam.config import SlamConfig
from facetcam.slam.map.map import Map
from facetcam.slam.map.places import Places
from facetcam.slam.map.trajectory import Trajectory
from facetcam.slam.mapping.loops import LoopCloser
from facetcam.slam.mapping.mapper import Mapper
from facetcam.slam.rig_check.audit import audit_rig
from facetcam.slam.rig_check.check import RigCheck
from facetcam.slam.tracking.fix import Fix
from facetcam.slam.tracking.uncertainty import drift_of

Array = NDArray[np.float64]

_FIRST_GLOBAL = 5  # keyframes
_GLOBAL_GROWTH = 1.5
_LAST_ROUNDS = 4


class Grower:
    """Adds keyframes to the map, closes loops, and adjusts the whole map now and then.

    Parameters
    ----------
    map, places, mapper, adjuster, closer, rig_check, optics, config
        The parts of the system.

    Attributes
    ----------
    scale_sigma : float
        Relative standard deviation of the map's scale, inf where the images cannot tell it or deny it.
    tested : float
        The same as earlier runs have told it.
    loops : int
        Closed in this run.
    """

    def __init__(
        self,
        map: Map,
        places: Places,
        mapper: Mapper,
        adjuster: Adjuster,
        closer: LoopCloser,
        rig_check: RigCheck,
        optics: Optics,
        config: SlamConfig,
    ) -> None:
        self._map = map
        self._places = places
        self._mapper = mapper
        self._adjuster = adjuster
        self._closer = closer
        self._rig_check = rig_check
        self._optics = optics
        self._config = config
        self.scale_sigma = self.tested = np.inf
        self.loops = 0
        self._maps = 1
        self._next_global = _FIRST_GLOBAL

    @property
    def metric(self) -> bool:
        """True where the images prove the scale of the map."""
        return self.proven(self.scale_sigma)

    def proven(self, scale_sigma: float) -> bool:
        """Tell whether a map of that sigma is metric."""
        return scale_sigma < self._config.metric_sigma

    def grow(self, frame: Frame, fix: Fix, odometry: Array | None, trajectory: Trajectory) -> None:
        """Make a keyframe; in real time this runs beside tracking."""
        keyframe = self._mapper.insert(frame, fix.T_world_rig, fix.seen, odometry, self._config.gate)
        with self._map.lock:
            keyframe.drift = drift_of(keyframe, fix.pose.covariance, self._map.keyframes[-2])
            trajectory.rehang(keyframe)
            for recent in self._map.keyframes[-self._config.window :]:
                if recent.session == keyframe.session:
                    recent.velocity = trajectory.velocity(recent.timestamp)
            for settled in self._map.keyframes[self._places.indexed : -self._config.window]:
                self._places.add(settled)
                settled.corners = Corners.none()  # the index has what is worth keeping
        if len(self._map.keyframes) < _FIRST_GLOBAL:
            self._adjuster.give_covariances()
        loop = self._closer.close(keyframe, self.metric)
        if loop is not None:
            self.loops += 1
            self._adjuster.adjust_coarsely()
        if loop is not None or len(self._map.keyframes) >= self._next_global:
            self.adjust_all()

    def adjust_all(self, last: bool = False) -> None:
        """Adjust the whole map, since a window freezes the scale of its past, and judge the scale.

        It is done whenever the map has grown by a fixed share, so that its cost a frame stays bounded.
        """
        if not self.metric:
            self._mapper.seek_scale()
        self._mapper.handovers.take_up()
        if last:
            self.loops += self._closer.ends_in_a_loop()
            self._adjuster.adjust_coarsely()  # out of what minima the map has fallen into on its way
        for _ in range(_LAST_ROUNDS if last else 1):
            self._adjuster.wheels.compare(self._map.keyframes, self.scale_sigma)
            self._adjuster.adjust_all(last)
            settled = self._adjuster.nuisances
            self.judge()
            if np.array_equal(self._adjuster.nuisances, settled):
                break
        self._ask_for_the_rig()
        self._settle()

    def judge(self) -> None:
        """Tell how well the map, as it is now, knows its scale."""
        evidence = self._mapper.handovers.evidence()
        self.scale_sigma = evidence.tested(self._adjuster.judge(), self.tested)

    def _ask_for_the_rig(self) -> None:
        """A map that is sure of its scale must bear out the rig that this comes from."""
        asked = self._optics, self._adjuster, self._config.pixel_sigma
        self._rig_check.audit = audit_rig(*asked) if self.metric else None

    def go_on(self, scale_sigma: float, tested: float) -> None:
        """Grow from a map of that scale; `tested` is its sigma as earlier runs have told it."""
        self.scale_sigma, self.tested = scale_sigma, tested
        self._settle()

    def start_again(self) -> None:
        """Forget the map."""
        self._map.clear()
        self._adjuster.believe(np.zeros(3))
        self._adjuster.wheels.metre = 1.0
        self._map.number, self._maps = self._maps, self._maps + 1
        self._places.clear()
        self._closer.forget()
        self._mapper.denied = False
        self.scale_sigma = self.tested = np.inf
        self._next_global = _FIRST_GLOBAL

    def _settle(self) -> None:
        self._next_global = int(_GLOBAL_GROWTH * len(self._map.keyframes)) + 1
