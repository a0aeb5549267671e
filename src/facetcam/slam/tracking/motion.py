"""Where the rig is and how it goes on: from frame to frame by sight, and by its wheels where sight fails."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from facetcam.geometry import se3
from facetcam.slam.map.map import Keyframe
from facetcam.slam.map.trajectory import Trajectory
from facetcam.slam.odometry.planar import planar_motion
from facetcam.slam.tracking.fix import BESIDE, Fix
from facetcam.slam.tracking.trust import Reckoning
from facetcam.slam.tracking.uncertainty import reckoned_covariance

Array = NDArray[np.float64]

_PLANAR = np.array([False, False, True, True, True, False])  # of a twist, what wheels can tell
_MAX_STEPS = 3.0  # for which a motion is taken to go on
_FASTEST = (10.0, 20.0)  # metres and radians a second squared, by which a rig changes its motion at most
_MOMENT = 1.0  # seconds
_UNSURE = (0.1, 0.1)  # metres and radians by which a pose may differ in any case


@dataclass(frozen=True, slots=True)
class Start:
    """The first two keyframes, the frames solved besides, and the last motion with the seconds it took."""

    first: Keyframe
    last: Keyframe
    solved: list[tuple[float, Fix]]
    T_step: Array
    step: float


@dataclass(slots=True)
class Motion:
    """The way of the rig so far.

    Attributes
    ----------
    trajectory : Trajectory
    placed : bool
        In the map, at least once in this run.
    lost_frames : int
        Frames since the last one with a pose from sight.
    odometry : (3,) array or None
        Of the last frame.
    covariance : (6, 6) array
        Of the last pose.
    carried : bool
        Away from where its wheels stand: they tell nothing until the rig is found.
    """

    trajectory: Trajectory = field(default_factory=Trajectory)
    placed: bool = False
    lost_frames: int = 0
    odometry: Array | None = None
    covariance: Array = field(default_factory=lambda: np.zeros((6, 6)))
    carried: bool = False
    _T_step: Array = field(default_factory=lambda: np.eye(4))  # between the last two frames
    _step: float = 0.0  # seconds it took
    _reckoning: Reckoning | None = None  # of a lost rig

    @property
    def velocity(self) -> Array:
        """Right-hand twist (6,) a second of the last step; zero where the rig is lost."""
        if self.lost_frames or not self._step:
            return np.zeros(6)
        return np.asarray(se3.log(self._T_step) / self._step)

    def begin(self, start: Start) -> None:
        """A map was started from two frames; those in between have poses, too."""
        for timestamp, fix in start.solved:
            self.trajectory.add(timestamp, fix.T_world_rig, start.first, fix.seen)
        for keyframe in (start.first, start.last):
            self.trajectory.add(keyframe.timestamp, keyframe.T_world_rig, keyframe)
        self._T_step, self._step, self.placed = start.T_step, start.step, True

    def resume(self, start: Start) -> None:
        """The map goes on from two frames of a rig that was lost; their poses were reckoned until now."""
        for keyframe in (start.first, start.last):
            self.trajectory.rehang(keyframe)
        self._T_step, self._step = start.T_step, start.step
        self.lost_frames, self._reckoning = 0, None

    def forget(self) -> None:
        """The map was wrong, and so are the poses in it."""
        self.trajectory.clear()
        self.lost_frames, self.carried = 0, False

    def go_back(self, keyframe: Keyframe) -> None:
        """The poses since the last keyframe were wrong: forget them, and go on from there."""
        self.trajectory.forget_after(keyframe.timestamp)
        self.odometry = keyframe.odometry
        self._T_step = se3.exp(self.trajectory.velocity(keyframe.timestamp) * self._step)

    def predictions(self, timestamp: float, odometry: Array | None) -> list[Array]:
        """Where the rig may be, the likeliest first: by odometry, if there is some, and by inertia."""
        if not self.placed:
            return []
        last = self.trajectory.last()
        steps = (timestamp - self.trajectory.last_timestamp) / self._step if self._step else 1.0
        twist = min(steps, _MAX_STEPS) * se3.log(self._T_step)
        inertial = last @ se3.exp(twist)
        if odometry is None or self.odometry is None:
            return [inertial]
        wheels = se3.log(planar_motion(self.odometry, odometry, 0.0)[0])
        return [last @ se3.exp(np.where(_PLANAR, wheels, twist)), inertial]

    def told(self, odometry: Array | None, sigma: float) -> tuple[Array, Array] | None:
        """The pose (4, 4) to which the wheels have carried a rig in sight, with its covariance (6, 6)."""
        if not self.placed or self.lost_frames or odometry is None or self.odometry is None:
            return None
        T_step, covariance = planar_motion(self.odometry, odometry, sigma)
        return self.trajectory.last() @ T_step, covariance

    def jumps(self, timestamp: float, T_world_rig: Array, predictions: list[Array]) -> bool:
        """Tell whether a pose is farther from each prediction than a rig can get since the last pose."""
        if not predictions or self.lost_frames:
            return False
        passed = timestamp - self.trajectory.last_timestamp
        off = np.array([se3.log(se3.inverse(T) @ T_world_rig).reshape(2, 3) for T in predictions])
        turn, way = np.linalg.norm(off, axis=2).T
        near = (way < _UNSURE[0] + _FASTEST[0] * passed**2) & (turn < _UNSURE[1] + _FASTEST[1] * passed**2)
        return not near.any()

    def is_beside(self, timestamp: float, T_world_rig: Array, predictions: list[Array]) -> bool:
        """Tell whether a rig that was in sight a moment ago is near where it was going."""
        if not self.placed or timestamp - self.trajectory.last_timestamp > _MOMENT:
            return False
        off = np.array([se3.log(se3.inverse(T) @ T_world_rig).reshape(2, 3) for T in predictions])
        return bool(np.any(np.all(np.linalg.norm(off, axis=2) < BESIDE, axis=1)))

    def reckoned(self, odometry: Array | None) -> Reckoning | None:
        """Where wheels without a gap since the loss have carried a lost rig."""
        if self._reckoning is None or odometry is None or self.odometry is None:
            return None
        return self._reckoning.further(planar_motion(self.odometry, odometry, 0.0)[0])

    @property
    def stands(self) -> bool:
        """Tell whether proven wheels have not moved since the rig was lost."""
        return self._reckoning is not None and self._reckoning.stands

    def distrust_wheels(self) -> None:
        """They stand while all looks otherwise: somebody has carried the rig."""
        self.carried = True
        self.trajectory.forget_reckoned()

    def follow(self, timestamp: float, fix: Fix, keyframe: Keyframe, odometry: Array | None) -> None:
        """Sight has found the rig."""
        T_before = None
        if self.lost_frames and odometry is not None and self.odometry is not None:
            T_before = planar_motion(self.odometry, odometry, 0.0)[0]
        if self.placed:
            step = se3.inverse(self.trajectory.last()) @ fix.T_world_rig
            self._T_step = np.eye(4) if self.lost_frames else step
            self._step = timestamp - self.trajectory.last_timestamp
        self.trajectory.add(timestamp, fix.T_world_rig, keyframe, fix.seen, T_before)
        self.lost_frames, self.placed, self._reckoning, self.carried = 0, True, None, False

    def lose(self, odometry: Array | None, wheels_foretell: bool, wheels_proven: bool) -> None:
        """Sight has not found the rig; wheels that have not been refuted go on from where it was."""
        if self.placed and not self.lost_frames and wheels_foretell:
            self._reckoning = Reckoning(self.trajectory.last(), proven=wheels_proven)
        self._reckoning = self.reckoned(odometry)
        self.lost_frames += 1

    def roll(
        self, timestamp: float, odometry: Array | None, sigma: float, keyframe: Keyframe
    ) -> Array | None:
        """The pose (4, 4) to which wheels of relative error `sigma` have carried the rig, if they tell."""
        if self.carried or not self.placed or odometry is None or self.odometry is None:
            return None
        T_step, covariance = planar_motion(self.odometry, odometry, sigma)
        T_world_rig = self.trajectory.last() @ T_step
        self.covariance = reckoned_covariance(self.covariance, T_step, covariance)
        self.trajectory.add(timestamp, T_world_rig, keyframe, T_before=T_step)
        return T_world_rig
