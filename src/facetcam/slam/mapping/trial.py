"""A first map on trial: the frames between and before its two keyframes must fit it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeGuard

import numpy as np
from numpy.typing import NDArray

from facetcam.geometry import se3
from facetcam.slam.camera.frame import Frame
from facetcam.slam.map.map import Keyframe, Map
from facetcam.slam.mapping.mapper import Mapper
from facetcam.slam.relative_pose.following import Links
from facetcam.slam.scale.search import home_of_points
from facetcam.slam.tracking.fix import Fix
from facetcam.slam.tracking.tracker import Tracker

Array = NDArray[np.float64]

_TRIALS = 3  # frames between in which a point was looked for
_LEAST_FOUND = 0.5  # share of them in which a point of the world is found
_MOST_RARE = 0.2  # of a view's points


@dataclass(frozen=True, slots=True)
class Waiting:
    """A frame before the map, with links from the corners of those before it."""

    frame: Frame
    odometry: Array | None
    links: Links


class Trial:
    """Finds frames in a map of two keyframes.

    Parameters
    ----------
    map : Map
    mapper : Mapper
    tracker : Tracker
    """

    def __init__(self, map: Map, mapper: Mapper, tracker: Tracker) -> None:
        self._map = map
        self._mapper = mapper
        self._tracker = tracker

    def between(
        self, a: Keyframe, b: Keyframe, waiting: list[Waiting]
    ) -> tuple[list[tuple[float, Fix]], float]:
        """Poses of the frames between the first keyframes, and the share of these frames that fit.

        Points that most of them lack are dropped: corners that look alike have met at a wrong depth.
        """
        solved = []
        for between in waiting[1:-1]:
            time = between.frame.timestamp
            fix = self._tracker.find(between.frame, interpolated(a, b, time))
            if is_clear(fix):
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

    def before(self, a: Keyframe, b: Keyframe, passed: list[Waiting]) -> list[tuple[float, Fix]]:
        """Poses of the frames that were left behind, from the first keyframe backwards as the rig came."""
        solved = []
        T, time, twist = a.T_world_rig, a.timestamp, _twist(a, b)
        for before in reversed(passed):
            elapsed = before.frame.timestamp - time
            fix = self._tracker.find(before.frame, T @ se3.exp(elapsed * twist), T)
            if not is_clear(fix):
                break
            twist = se3.log(se3.inverse(T) @ fix.T_world_rig) / elapsed
            T, time = fix.T_world_rig, before.frame.timestamp
            solved.append((time, fix))
        return solved


def is_clear(fix: Fix | None) -> TypeGuard[Fix]:
    """Tell whether a frame was found in the map beyond doubt."""
    return fix is not None and fix.clear


def _twist(a: Keyframe, b: Keyframe) -> Array:
    """Right-hand twist (6,) a second from one keyframe to the other."""
    return se3.log(se3.inverse(a.T_world_rig) @ b.T_world_rig) / (b.timestamp - a.timestamp)


def interpolated(a: Keyframe, b: Keyframe, timestamp: float) -> Array:
    """Pose between two keyframes at a constant twist."""
    return a.T_world_rig @ se3.exp((timestamp - a.timestamp) * _twist(a, b))
