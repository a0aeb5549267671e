"""What happens in every frame: the map is followed, grows, is lost and found again, or begins."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from facetcam.slam.camera.frame import Frame
from facetcam.slam.config import SlamConfig
from facetcam.slam.mapping.atlas import Chart
from facetcam.slam.odometry.check import OdometryCheck
from facetcam.slam.odometry.planar import planar_pose
from facetcam.slam.parts import Parts
from facetcam.slam.state import State, Status, ViewHealth
from facetcam.slam.stopwatch import Stopwatch
from facetcam.slam.threads import Background
from facetcam.slam.tracking.fix import Fix
from facetcam.slam.tracking.localiser import Localiser
from facetcam.slam.tracking.motion import Motion, Start
from facetcam.slam.tracking.uncertainty import pose_covariance

Array = NDArray[np.float64]

_PATIENCE = 10  # lost frames
_FOR_GOOD = 1.0  # seconds of a rig that is lost, from which it may begin another map


class MainLoop:
    """Takes frame after frame.

    Parameters
    ----------
    parts, motion, config
        Of the system.
    mapping : Background
        Where the map grows.
    stopwatch : Stopwatch

    Attributes
    ----------
    localise_only : bool
        The map stays as it is.
    """

    def __init__(
        self, parts: Parts, motion: Motion, config: SlamConfig, mapping: Background, stopwatch: Stopwatch
    ) -> None:
        self._parts = parts
        self._map = parts.map
        self._motion = motion
        self._config = config
        self._mapping = mapping
        self._timed = stopwatch.timed
        self._localiser = Localiser(parts.map, parts.tracker, motion, config, parts.optics.n_views)
        self._continued = False  # a map of an earlier run
        self.localise_only = False

    def go_on(self, localise_only: bool) -> None:
        """The map is that of an earlier run: the rig must be found there first."""
        self._continued, self.localise_only = True, localise_only
        self._localiser.doubt()

    def settle(self) -> None:
        """Go over to the map of the run that counts, and be lost there if it is another one."""
        main = self._parts.atlas.main(self._motion.trajectory)
        if main.map is not self._map:
            self._go_back(main)
            self._localiser.doubt()

    def _go_back(self, left: Chart) -> None:
        """Follow a map that was left."""
        self._mapping.wait()
        self._parts.atlas.go_back(left, self._motion.trajectory, worthless=self._young)
        self._parts.resumer.forget()
        self._parts.starter.forget()
        self._motion.lost_frames += 1

    def take(self, frame: Frame, wheels: Array | None, check: OdometryCheck) -> State:
        """One frame with its odometry, and what the film has said of it."""
        if self._parts.mapper.denied and self._young:
            self._forget()
        if self._map.keyframes:
            state = self._follow(frame, wheels, check)
        else:
            state = self._start(frame, wheels)
        self._motion.odometry = wheels
        return state

    def _follow(self, frame: Frame, wheels: Array | None, check: OdometryCheck) -> State:
        """Predict, measure the map in every view, solve the pose, and grow the map where it is due."""
        grows = not self.localise_only and not self._mapping.busy
        with self._map.lock:
            with self._timed("track"):
                fix = self._localiser.find(frame, wheels, check.foretells, grows)
            if fix is not None and self._motion.lost_frames:
                self._parts.resumer.forget()
            due = fix is not None and self._localiser.accept(frame, fix, wheels)
        if fix is None:
            return self._miss(frame, wheels, check)
        keyframe = due and grows
        if keyframe:
            self._mapping.run(lambda: self._grow(frame, fix, wheels))
        return self._found(frame, fix, keyframe)

    def _grow(self, frame: Frame, fix: Fix, wheels: Array | None) -> None:
        with self._timed("map"):
            self._parts.grower.grow(frame, fix, wheels, self._motion.trajectory)
            self._parts.atlas.rejoin(self._motion.trajectory)

    def _miss(self, frame: Frame, wheels: Array | None, check: OdometryCheck) -> State:
        """No pose from the images: follow the wheels, or say that the rig is lost."""
        self._motion.lose(wheels, check.foretells, check.agrees)
        self._localiser.doubt()
        if self._motion.lost_frames > _PATIENCE and self._young:
            self._forget()
            return self._start(frame, wheels)
        with self._map.lock:
            last = self._map.keyframes[-1]
            T = self._motion.roll(frame.timestamp, wheels, self._config.odometry_sigma, last)
        if self._motion.stands and self._parts.resumer.in_vain:
            self._motion.distrust_wheels()
        if T is None or self._motion.carried:
            return self._elsewhere(frame) or self._anew(frame) or self._nowhere(frame, Status.LOST)
        if self._resumes(frame, wheels, check.agrees, T):
            return self._begun(frame, self._motion.trajectory.last(), self._motion.covariance)
        covariance = self._motion.covariance
        return State(
            frame.timestamp,
            Status.DEAD_RECKONING,
            T,
            covariance,
            map_points=self._n_points,
            map=self._map.number,
        )

    def _resumes(self, frame: Frame, wheels: Array | None, proven: bool, T_world_rig: Array) -> bool:
        """Go on with the map from where the wheels have carried the rig, once two frames show enough."""
        if self.localise_only or wheels is None:
            return False
        with self._timed("start"):
            start = self._parts.resumer.offer(frame, wheels, proven)
        if start is None:
            return False
        self._mapping.wait()
        start = self._parts.resumer.carry_over(start, T_world_rig, self._motion.covariance)
        self._motion.resume(start)
        self._localiser.trust_again()
        return True

    @property
    def _n_points(self) -> int:
        return int(np.count_nonzero(self._map.points.alive))

    @property
    def _of_earlier_run(self) -> bool:
        return self._continued and not self._map.number

    @property
    def _young(self) -> bool:
        return self._map.young and not self._of_earlier_run

    def _elsewhere(self, frame: Frame) -> State | None:
        """Go back to a map that was left, once the rig sees that one."""
        if not self._parts.atlas.left:
            return None
        with self._timed("start"):
            found = self._parts.atlas.found(frame)
        if found is None:
            return None
        left, fix = found
        self._go_back(left)
        self._localiser.accept(frame, fix, None)
        return self._found(frame, fix, keyframe=False)

    def _nowhere(self, frame: Frame, status: Status, T_world_rig: Array | None = None) -> State:
        return State(frame.timestamp, status, T_world_rig, map_points=self._n_points, map=self._map.number)

    def _offered(self, frame: Frame) -> Start | None:
        """A start by sight, once the rig has not seen the map for long."""
        if frame.timestamp - self._motion.trajectory.last_timestamp > _FOR_GOOD:
            return self._parts.resumer.offer(frame, None, False)
        self._parts.resumer.keep(frame)
        return None

    def _anew(self, frame: Frame) -> State | None:
        """Begin another map once there is a start: waiting to see this one again serves worse."""
        if not self._motion.placed or self.localise_only:
            return None
        with self._timed("start"):
            start = self._offered(frame)
        if start is None:
            return None
        self._mapping.wait()
        self._parts.atlas.leave(self._motion.trajectory)
        self._motion.forget()
        return self._follows_from(self._parts.resumer.carry_over(start, start.last.T_world_rig), frame)

    def _forget(self) -> None:
        """A map that fails this early was wrong: forget it with its poses."""
        self._mapping.wait()
        self._parts.grower.start_again()
        self._parts.resumer.forget()
        self._motion.forget()

    def _start(self, frame: Frame, wheels: Array | None) -> State:
        """Wait for two frames that can start the map."""
        if (state := self._elsewhere(frame)) is not None:
            return state
        with self._timed("start"):
            start = self._parts.starter.offer(frame, wheels)
        if start is None:
            return self._nowhere(frame, Status.STARTING, None if wheels is None else planar_pose(wheels))
        start.first.measured = start.last.measured = len(start.last.observations)
        return self._follows_from(start, frame)

    def _follows_from(self, start: Start, frame: Frame) -> State:
        """Follow the map that two frames have started."""
        self._motion.begin(start)
        self._parts.adjuster.give_covariances()
        self._localiser.trust_again()
        return self._begun(frame, start.last.T_world_rig.copy())

    def _begun(self, frame: Frame, T_world_rig: Array, covariance: Array | None = None) -> State:
        """State of a frame with which a map begins, or goes on."""
        return State(
            frame.timestamp,
            Status.TRACKING,
            T_world_rig,
            covariance,
            keyframe=True,
            map_points=self._n_points,
            map=self._map.number,
        )

    def _found(self, frame: Frame, fix: Fix, keyframe: bool) -> State:
        """State of a frame that was found in the map."""
        names = self._parts.optics.names
        expected, inliers = (
            np.bincount(rows.view, minlength=len(names)).tolist() for rows in (fix.predictions, fix.seen)
        )
        with self._map.lock:
            T_world_rig = self._motion.trajectory.last()
            self._motion.covariance = self._covariance(T_world_rig, fix)
        return State(
            timestamp=frame.timestamp,
            status=Status.TRACKING,
            T_world_rig=T_world_rig,
            covariance=self._motion.covariance,
            views={name: ViewHealth(*counts) for name, *counts in zip(names, expected, inliers)},
            keyframe=keyframe,
            metric=self._parts.metric,
            scale_sigma=self._parts.scale_sigma,
            map_points=self._n_points,
            map=self._map.number,
            pixels=fix.seen.pixels.astype(np.float32),
            pixel_views=fix.seen.view,
        )

    def _covariance(self, T_world_rig: Array, fix: Fix) -> Array:
        near = [self._motion.trajectory.last_keyframe, *self._map.keyframes[::-1]]
        wheels = self._motion.odometry is not None
        sigma = self._parts.scale_sigma
        return pose_covariance(T_world_rig, fix.pose.covariance, near, sigma, wheels)
