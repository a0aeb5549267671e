"""The first map: frames wait until two of them show enough parallax."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from facetcam.geometry import se3
from facetcam.slam.camera.corner_finder import CornerFinder
from facetcam.slam.camera.edges import are_corners
from facetcam.slam.camera.frame import Frame
from facetcam.slam.camera.optics import Optics
from facetcam.slam.config import SlamConfig
from facetcam.slam.map.map import Keyframe, Map
from facetcam.slam.map.measure import Measurements
from facetcam.slam.mapping.mapper import Mapper
from facetcam.slam.mapping.trial import Trial, Waiting, interpolated, is_clear
from facetcam.slam.odometry.planar import planar_motion, planar_pose
from facetcam.slam.relative_pose.confirmed_motion import (
    MIN_CONFIRMING,
    START_GATE,
    confirmed_motion,
    enough_parallax,
    much_alike,
)
from facetcam.slam.relative_pose.degenerate import standing_views
from facetcam.slam.relative_pose.doubt import views_aside
from facetcam.slam.relative_pose.following import Links, follow
from facetcam.slam.relative_pose.measured_motion import Measured
from facetcam.slam.relative_pose.pairs import Pairs, in_sight
from facetcam.slam.relative_pose.two_frames import MIN_MATCHES, STANDING, estimate_motion
from facetcam.slam.relative_pose.witnesses import shares
from facetcam.slam.tracking.motion import Start
from facetcam.slam.tracking.tracker import Tracker

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_NONE = np.empty(0, np.int64)
_MAX_WAITING = 40
_SHORT = 4  # waiting frames behind one that is tried as the first, at least
_LASTING = 5  # and in which one view may show what the wheels say: a person moves otherwise soon
_FARTHEST = 100.0  # metres of the median point: wheels that count in other units make a world of giants
_LEAST_CLEAR = 0.5  # share of the frames between the first two keyframes that must fit the map


def least_pairs(odometry: Array | None) -> int:
    """Corners without which a frame cannot start anything."""
    return MIN_MATCHES if odometry is None else MIN_CONFIRMING


class Starter:
    """Keeps frames until a pair of them can start the map; it never invents a motion.

    Parameters
    ----------
    map, optics, config, corners, mapper, tracker
        The parts of the system.
    """

    def __init__(
        self,
        map: Map,
        optics: Optics,
        config: SlamConfig,
        corners: CornerFinder,
        mapper: Mapper,
        tracker: Tracker,
    ) -> None:
        self._map = map
        self._optics = optics
        self._config = config
        self._corners = corners
        self._mapper = mapper
        self._tracker = tracker
        self._trial = Trial(map, mapper, tracker)
        self._waiting: list[Waiting] = []
        self._passed: list[Waiting] = []  # left behind, to be solved backwards from the map
        self._wheels_proven = False

    def offer(self, frame: Frame, odometry: Array | None, wheels_proven: bool = False) -> Start | None:
        """Take one more frame; returns the start once there is one.

        Where wheels are proven, it goes their way or none.
        """
        self._wheels_proven = wheels_proven
        self.keep(frame, odometry)
        if (start := self._start_at_once()) is not None:
            return start
        showing = self._showing()
        while len(self._waiting) > 1:
            pairs = self._pairs(0)
            start = self._start(0, pairs, showing)
            if start is not None:
                return start
            enough = len(pairs) >= least_pairs(odometry)
            usable = enough and in_sight(self._corners(self._waiting[0].frame), pairs)
            if usable and len(self._waiting) <= _MAX_WAITING:
                break
            self._passed = [*self._passed[-_MAX_WAITING:], self._waiting.pop(0)]
        for row in _halving(len(self._waiting)):
            start = self._start(row, self._pairs(row), showing)
            if start is not None:
                return start
        return None

    def keep(self, frame: Frame, odometry: Array | None) -> None:
        """Take one more frame without starting yet."""
        earlier = [self._corners(w.frame) for w in self._waiting[:-3:-1]]
        links = Links.of(self._corners(frame), earlier, self._config)
        self._waiting = [*self._waiting[-_MAX_WAITING:], Waiting(frame, odometry, links)]

    def forget(self) -> None:
        """Wait for frames anew."""
        self._waiting, self._passed = [], []

    def _pairs(self, row: int) -> Pairs:
        """Corners of a waiting frame, followed to the last one."""
        a, b = (self._corners(self._waiting[r].frame) for r in (row, -1))
        return Pairs.linked(a, b, follow(len(a), [w.links for w in self._waiting[row:][1:]]))

    def _showing(self) -> Index:
        """Views with something to follow: what they show is found again in the next frame."""
        pairs = self._pairs(-2) if len(self._waiting) > 1 else Pairs.none()
        return shares(pairs.views, pairs.move())[0]

    def _start_at_once(self) -> Start | None:
        """Start where views overlap: one frame gives its points a depth, and the next one is found there.

        Two views see how far an edge is, but not along it: corners must show how the rig moves.
        """
        if not self._optics.overlapping or len(self._waiting) < 2:
            return None
        first, new = self._waiting[-2:]
        measured = self._measured(first, new)
        a = self._first_keyframe(first, standing_views(self._pairs(-2)))
        predicted = a.T_world_rig if measured is None else a.T_world_rig @ measured.T_a_b
        fix = self._tracker.find(new.frame, predicted) if self._has_corners() else None
        if not is_clear(fix) or _contradicted(se3.inverse(a.T_world_rig) @ fix.T_world_rig, measured):
            self._map.clear()
            return None
        b = self._mapper.insert(new.frame, fix.T_world_rig, fix.seen, new.odometry, self._config.gate)
        solved = self._trial.before(a, b, [*self._passed, *self._waiting[:-2]])
        self.forget()
        return Start(a, b, solved, se3.inverse(a.T_world_rig) @ b.T_world_rig, b.timestamp - a.timestamp)

    def _start(self, row: int, pairs: Pairs, showing: Index) -> Start | None:
        """Start a map from a waiting frame and the last one, if they can."""
        passed, waiting = [*self._passed, *self._waiting[:row]], self._waiting[row:]
        for T_first_new in self._motions(waiting, pairs, showing):
            start = self._first_map(passed, waiting, T_first_new, standing_views(pairs))
            if start is not None:
                self.forget()
                return start
        return None

    def _motions(self, waiting: list[Waiting], pairs: Pairs, showing: Index) -> Iterator[Array]:
        """Motions with which a map may start: that of the wheels, then that of the images alone."""
        first, new = waiting[0], waiting[-1]
        measured = self._measured(first, new)
        if measured is not None:
            T = confirmed_motion(pairs, measured, self._optics)
            a, b = self._corners(first.frame), self._corners(new.frame)
            if T is not None:
                aside = views_aside(pairs, T, self._optics)
                several = len(np.setdiff1d(showing, aside)) > 1 and len(waiting) < _LASTING
                if enough_parallax(a, b, T, self._optics, self._config, aside, several):
                    yield T
                elif np.linalg.norm(T[:3, 3]) > STANDING:
                    return  # both say the same, and too little yet
        seen = estimate_motion(pairs, self._optics, len(np.setdiff1d(showing, standing_views(pairs))) > 1)
        if seen is not None and measured is not None and self._wheels_proven:
            seen = _of_its_length(seen, measured.T_a_b)
        if seen is not None:
            yield seen

    def _measured(self, first: Waiting, new: Waiting) -> Measured | None:
        """What the wheels say of the way between two frames."""
        if first.odometry is None or new.odometry is None:
            return None
        T, covariance = planar_motion(first.odometry, new.odometry, self._config.odometry_sigma)
        return Measured(T, np.sqrt(np.diag(covariance)[:3]))

    def _first_keyframe(self, first: Waiting, aside: Index = _NONE) -> Keyframe:
        origin = np.eye(4) if first.odometry is None else planar_pose(first.odometry)
        nothing = Measurements.none()
        return self._mapper.insert(first.frame, origin, nothing, first.odometry, START_GATE, aside)

    def _first_map(
        self, passed: list[Waiting], waiting: list[Waiting], T_first_new: Array, aside: Index
    ) -> Start | None:
        """Make two keyframes and try the map on the frames between them; forget it where it fails.

        What stands in both has no depth, or is no part of the world: views set `aside` give no points.
        """
        first, new = waiting[0], waiting[-1]
        a = self._first_keyframe(first)
        T_world_new = a.T_world_rig @ T_first_new
        b = self._mapper.insert(new.frame, T_world_new, Measurements.none(), new.odometry, START_GATE, aside)
        self._mapper.seek_scale()
        solved, share = self._trial.between(a, b, waiting)
        if self._too_few_or_far(a) or share < _LEAST_CLEAR:
            self._map.clear()
            return None
        solved += self._trial.before(a, b, passed)
        before = waiting[-2].frame.timestamp
        T_step = se3.inverse(interpolated(a, b, before)) @ b.T_world_rig
        return Start(a, b, solved, T_step, new.frame.timestamp - before)

    def _has_corners(self) -> bool:
        """Tell whether enough points of the map are corners."""
        points = self._map.points
        corners = are_corners(points.patch[points.alive], points.offset[points.alive])
        return int(np.count_nonzero(corners)) >= MIN_MATCHES // 2

    def _too_few_or_far(self, a: Keyframe) -> bool:
        xyz = self._map.points.xyz[self._map.points.alive]
        distance = np.linalg.norm(xyz - a.T_world_rig[:3, 3], axis=1)
        return len(xyz) < MIN_MATCHES // 2 or float(np.median(distance)) > _FARTHEST


def _halving(count: int) -> list[int]:
    """Rows half, a quarter, ... of the way before the last one: what is seen for but a while tells, too."""
    rows, span = [], count
    while (span := (span + 1) // 2) >= _SHORT:
        rows.append(count - span)
    return rows


def _contradicted(T_a_b: Array, measured: Measured | None) -> bool:
    """Tell whether wheels that turn say something else: what is part of the robot stands before it."""
    if measured is None or np.linalg.norm(measured.T_a_b[:3, 3]) < STANDING:
        return False
    return not much_alike(T_a_b, measured.T_a_b)


def _of_its_length(T_seen: Array, T_wheels: Array) -> Array | None:
    """A motion that sight has told, as long as proven wheels say; None where they say something else."""
    T, length = T_seen.copy(), np.linalg.norm(T_wheels[:3, 3])
    T[:3, 3] *= length / np.linalg.norm(T_seen[:3, 3])
    return T if length > STANDING and much_alike(T, T_wheels) else None
