"""The first map: frames wait until two of them show enough parallax."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeGuard

import numpy as np
from numpy.typing import NDArray

from facetcam.geometry import se3
from facetcam.slam.camera.corner_finder import CornerFinder
from facetcam.slam.camera.frame import Frame
from facetcam.slam.camera.optics import Optics
from facetcam.slam.config import SlamConfig
from facetcam.slam.map.map import Keyframe, Map
from facetcam.slam.map.measure import Measurements
from facetcam.slam.mapping.mapper import Mapper
from facetcam.slam.odometry.planar import planar_motion, planar_pose
from facetcam.slam.relative_pose.doubt import views_aside
from facetcam.slam.relative_pose.following import Links, follow
from facetcam.slam.relative_pose.measured_motion import Measured
from facetcam.slam.relative_pose.pairs import Pairs, in_sight
from facetcam.slam.relative_pose.two_frames import (
    MIN_MATCHES,
    STANDING,
    START_GATE,
    confirmed_motion,
    enough_parallax,
    estimate_motion,
    standing_views,
)
from facetcam.slam.relative_pose.witnesses import shares
from facetcam.slam.scale.search import home_of_points
from facetcam.slam.tracking.fix import Fix
from facetcam.slam.tracking.motion import Start
from facetcam.slam.tracking.tracker import Tracker

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_MAX_WAITING = 40
_LONG = 8  # waiting frames from which the middle one is tried as the first, too
_LASTING = 5  # and in which one view may show what the wheels say: a person moves otherwise soon
_FARTHEST = 100.0  # metres of the median point: wheels that count in other units make a world of giants
_TRIALS = 3  # frames between in which a point was looked for
_LEAST_FOUND = 0.5  # share of them in which a point of the world is found
_MOST_RARE = 0.2  # of a view's points
_LEAST_CLEAR = 0.5  # share of the frames between the first two keyframes that must fit the map


@dataclass(frozen=True, slots=True)
class Waiting:
    """A frame before the map, with links from the corners of those before it."""

    frame: Frame
    odometry: Array | None
    links: Links


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
        self._waiting: list[Waiting] = []
        self._passed: list[Waiting] = []  # left behind, to be solved backwards from the map
        self._wheels_proven = False

    def offer(self, frame: Frame, odometry: Array | None, wheels_proven: bool = False) -> Start | None:
        """Take one more frame; returns the start once there is one.

        Where wheels are proven, it goes their way or none.
        """
        self._wheels_proven = wheels_proven
        earlier = [self._corners(w.frame) for w in self._waiting[:-3:-1]]
        links = Links.of(self._corners(frame), earlier, self._config)
        self._waiting.append(Waiting(frame, odometry, links))
        showing = self._showing()
        while len(self._waiting) > 1:
            pairs = self._pairs(0)
            start = self._start(0, pairs, showing)
            if start is not None:
                return start
            usable = len(pairs) >= MIN_MATCHES and in_sight(self._corners(self._waiting[0].frame), pairs)
            if usable and len(self._waiting) <= _MAX_WAITING:
                break
            self._passed = [*self._passed[-_MAX_WAITING:], self._waiting.pop(0)]
        middle = len(self._waiting) // 2
        return self._start(middle, self._pairs(middle), showing) if len(self._waiting) >= _LONG else None

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
        if first.odometry is not None and new.odometry is not None:
            wheels, covariance = planar_motion(first.odometry, new.odometry, self._config.odometry_sigma)
            measured = Measured(wheels, np.sqrt(np.diag(covariance)[:3]))
            T = confirmed_motion(pairs, measured, self._optics)
            a, b = self._corners(first.frame), self._corners(new.frame)
            if T is not None:
                aside = views_aside(pairs, T, self._optics)
                several = len(np.setdiff1d(showing, aside)) > 1 and len(waiting) < _LASTING
                if enough_parallax(a, b, T, self._optics, self._config, aside, several):
                    yield T
                elif np.linalg.norm(T[:3, 3]) > STANDING:
                    return  # both say the same, and too little yet
            if self._wheels_proven:
                return
        seen = estimate_motion(pairs, self._optics, len(np.setdiff1d(showing, standing_views(pairs))) > 1)
        if seen is not None:
            yield seen

    def _first_map(
        self, passed: list[Waiting], waiting: list[Waiting], T_first_new: Array, aside: Index
    ) -> Start | None:
        """Make two keyframes and try the map on the frames between them; forget it where it fails.

        What stands in both has no depth, or is no part of the world: views set `aside` give no points.
        """
        first, new = waiting[0], waiting[-1]
        origin = np.eye(4) if first.odometry is None else planar_pose(first.odometry)
        a = self._mapper.insert(first.frame, origin, Measurements.none(), first.odometry, START_GATE)
        b = self._mapper.insert(
            new.frame, origin @ T_first_new, Measurements.none(), new.odometry, START_GATE, aside
        )
        self._mapper.seek_scale()
        solved, share = self._between(a, b, waiting)
        if self._too_few_or_far(a) or share < _LEAST_CLEAR:
            self._map.clear()
            return None
        solved += self._before(a, b, passed)
        before = waiting[-2].frame.timestamp
        T_step = se3.inverse(_interpolated(a, b, before)) @ b.T_world_rig
        return Start(a, b, solved, T_step, new.frame.timestamp - before)

    def _too_few_or_far(self, a: Keyframe) -> bool:
        xyz = self._map.points.xyz[self._map.points.alive]
        distance = np.linalg.norm(xyz - a.T_world_rig[:3, 3], axis=1)
        return len(xyz) < MIN_MATCHES // 2 or float(np.median(distance)) > _FARTHEST

    def _between(
        self, a: Keyframe, b: Keyframe, waiting: list[Waiting]
    ) -> tuple[list[tuple[float, Fix]], float]:
        """Poses of the frames between the first keyframes, and the share of these frames that fit.

        Points that most of them lack are dropped: corners that look alike have met at a wrong depth.
        """
        solved = []
        for between in waiting[1:-1]:
            time = between.frame.timestamp
            fix = self._tracker.find(between.frame, _interpolated(a, b, time))
            if _is_clear(fix):
                solved.append((time, fix))
        self._drop_rare([fix for _, fix in solved])
        return solved, len(solved) / (len(waiting) - 2) if len(waiting) > 2 else 1.0

    def _drop_rare(self, fixes: list[Fix]) -> None:
        """Drop points that most frames lack in which they were looked for, in whatever view.

        Where a view lacks many, rather the poses or the scale are wrong, which these points may tell yet.
        """
        expected, found = np.zeros((2, len(self._map.points)), dtype=int)
        for fix in fixes:
            expected[np.unique(fix.predictions.point)] += 1
            found[np.unique(fix.seen.point)] += 1
        rare = (expected >= _TRIALS) & (found < _LEAST_FOUND * expected)
        home = home_of_points(self._map)
        for view in np.unique(home[rare]):
            if np.mean(rare[home == view]) > _MOST_RARE:
                rare[home == view] = False
        self._mapper.drop(rare)

    def _before(self, a: Keyframe, b: Keyframe, passed: list[Waiting]) -> list[tuple[float, Fix]]:
        """Poses of the frames that were left behind, from the first keyframe backwards as the rig came."""
        solved = []
        T, time, twist = a.T_world_rig, a.timestamp, _twist(a, b)
        for before in reversed(passed):
            elapsed = before.frame.timestamp - time
            fix = self._tracker.find(before.frame, T @ se3.exp(elapsed * twist), T)
            if not _is_clear(fix):
                break
            twist = se3.log(se3.inverse(T) @ fix.T_world_rig) / elapsed
            T, time = fix.T_world_rig, before.frame.timestamp
            solved.append((time, fix))
        return solved


def _is_clear(fix: Fix | None) -> TypeGuard[Fix]:
    return fix is not None and fix.clear


def _twist(a: Keyframe, b: Keyframe) -> Array:
    """Right-hand twist (6,) a second from one keyframe to the other."""
    return se3.log(se3.inverse(a.T_world_rig) @ b.T_world_rig) / (b.timestamp - a.timestamp)


def _interpolated(a: Keyframe, b: Keyframe, timestamp: float) -> Array:
    """Pose between two keyframes at a constant twist."""
    return a.T_world_rig @ se3.exp((timestamp - a.timestamp) * _twist(a, b))
