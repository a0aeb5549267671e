"""The maps of a run: a rig that is lost for good begins another, and both are joined where they meet.

Each map has a world of its own until then (R. Elvira, J. D. Tardos, J. M. M. Montiel, "ORBSLAM-Atlas", 2019).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from facetcam.slam.adjustment.adjuster import Adjuster
from facetcam.slam.camera.corner_finder import CornerFinder
from facetcam.slam.camera.frame import Corners, Frame
from facetcam.slam.map.common_points import growth_between
from facetcam.slam.map.joining import Similarity, move_world, take_in
from facetcam.slam.map.map import Keyframe, Map
from facetcam.slam.map.places import Places
from facetcam.slam.map.trajectory import Trajectory
from facetcam.slam.mapping.grower import Grower
from facetcam.slam.mapping.loops import LoopCloser
from facetcam.slam.tracking.fix import Fix
from facetcam.slam.tracking.trust import Trust

_AGREEING = 4  # keyframes that must find one place in the other map
_AGREEING_IN_VIEWS = 2  # and where more views than one do
_LATEST = 1 << 31  # run


@dataclass(frozen=True, slots=True, eq=False)
class Chart:
    """A map, the way that the rig went in it, and what knows its places.

    `scale_sigma` and `tested` are those of its `Grower`; `trust` guards who comes back to it.
    """

    map: Map
    places: Places
    trajectory: Trajectory
    closer: LoopCloser
    scale_sigma: float
    tested: float
    trust: Trust

    @property
    def rank(self) -> tuple[int, int]:
        """What counts of several: that of the earliest run, then that in which the rig was longest."""
        keyframes = self.map.keyframes
        return (-keyframes[0].session, len(self.trajectory)) if keyframes else (-_LATEST, 0)


@dataclass(frozen=True, slots=True, eq=False)
class Meeting:
    """How the map lies in a left one, as some keyframes in a row find it."""

    left: Chart
    into_left: Similarity
    fix: Fix
    times: int = 1

    @property
    def sure(self) -> bool:
        """What repeats looks alike elsewhere, but hardly from several places, or through several mirrors."""
        return self.times >= (_AGREEING_IN_VIEWS if self.fix.witnesses > 1 else _AGREEING)


class Atlas:
    """Keeps the maps that the rig has left, and joins them with the present one.

    Parameters
    ----------
    map, places, adjuster, closer, grower
        Of the present map.
    corners : CornerFinder
    n_views : int
    closer_of : callable
        Makes a `LoopCloser` of another map and its places.

    Attributes
    ----------
    left : list of Chart
    """

    def __init__(
        self,
        map: Map,
        places: Places,
        adjuster: Adjuster,
        closer: LoopCloser,
        grower: Grower,
        corners: CornerFinder,
        n_views: int,
        closer_of: Callable[[Map, Places], LoopCloser],
    ) -> None:
        self._map = map
        self._places = places
        self._adjuster = adjuster
        self._closer = closer
        self._grower = grower
        self._corners = corners
        self._n_views = n_views
        self._closer_of = closer_of
        self._turn = 0
        self._meeting: Meeting | None = None
        self.left: list[Chart] = []

    def main(self, trajectory: Trajectory) -> Chart:
        """The map that counts, which may be the present one, in which the rig went that way."""
        present = self._chart(self._map, self._places, trajectory, self._closer)
        return max([present, *self.left], key=lambda chart: chart.rank)

    def _chart(self, map: Map, places: Places, trajectory: Trajectory, closer: LoopCloser) -> Chart:
        trust = Trust(self._n_views)
        trust.lose()
        known = self._grower.scale_sigma, self._grower.tested
        return Chart(map, places, trajectory, closer, *known, trust)

    def leave(self, trajectory: Trajectory) -> None:
        """Put the map and the way in it aside; the next one is seen through the same camera."""
        self._grower.adjust_all()
        for keyframe in self._map.keyframes[self._places.indexed :]:
            self._places.add(keyframe)
        for keyframe in self._map.keyframes:
            keyframe.frame, keyframe.corners = None, Corners.none()
        camera = self._adjuster.nuisances
        with self._map.lock:
            map, places, way = self._map.moved_out(), self._places.moved_out(), trajectory.moved_out()
            self.left.append(self._chart(map, places, way, self._closer_of(map, places)))
        self._meeting = None
        self._grower.start_again()
        self._adjuster.believe(camera)

    def found(self, frame: Frame) -> tuple[Chart, Fix] | None:
        """A left map in which a lost rig sees where it is, one of them looked at in each frame."""
        self._turn += 1
        left = self.left[self._turn % len(self.left)]
        fix = left.closer.recognised(frame, self._corners(frame))
        return (left, fix) if fix is not None and left.trust.believes(fix) else None

    def go_back(self, left: Chart, trajectory: Trajectory, worthless: bool) -> None:
        """Follow a left map in place of the present one, which is left in its turn if it is worth it."""
        if worthless:
            self._grower.start_again()
            trajectory.clear()
        else:
            self.leave(trajectory)
        self.left.remove(left)
        with self._map.lock:
            self._map.become(left.map)
            self._places.join(left.places, 0, len(left.map.keyframes))
            trajectory.join(left.trajectory, 0)
        self._grower.go_on(left.scale_sigma, left.tested)
        self._adjuster.believe(self._adjuster.nuisances)

    def rejoin(self, trajectory: Trajectory) -> None:
        """Join the map with a left one, if its last keyframes have seen places of that one."""
        if not self.left:
            return
        keyframe = self._map.keyframes[-1]
        self._meeting = self._met_again(keyframe) or self._met(keyframe)
        if self._meeting is not None and self._meeting.sure:
            self._join(self._meeting, trajectory)
            self._meeting = None

    def _met(self, keyframe: Keyframe) -> Meeting | None:
        """Look for a keyframe in one of the left maps, another one each time."""
        assert keyframe.frame is not None
        left = self.left[keyframe.index % len(self.left)]
        fix = left.closer.recognised(keyframe.frame, keyframe.corners, keyframe.velocity)
        growth = None if fix is None else self._growth(keyframe, fix, left)
        if fix is None or growth is None:
            return None
        return Meeting(left, Similarity.between(fix.T_world_rig, keyframe.T_world_rig, growth), fix)

    def _met_again(self, keyframe: Keyframe) -> Meeting | None:
        """Look for a keyframe where those before it say that it is in a left map."""
        meeting = self._meeting
        if meeting is None or keyframe.frame is None:
            return None
        there = meeting.into_left.pose(keyframe.T_world_rig)
        fix = meeting.left.closer.recognised_near(there, keyframe.frame, keyframe.velocity)
        if fix is None:
            return None
        growth = self._growth(keyframe, fix, meeting.left) or meeting.into_left.growth
        into_left = Similarity.between(fix.T_world_rig, keyframe.T_world_rig, growth)
        return Meeting(meeting.left, into_left, fix, meeting.times + 1)

    def _growth(self, keyframe: Keyframe, fix: Fix, left: Chart) -> float | None:
        here, there = self._map.points.xyz, left.map.points.xyz
        apart = replace(fix.seen, point=fix.seen.point + len(here))  # ids of two maps are not the same points
        return growth_between(keyframe, fix.T_world_rig, apart, here, np.concatenate([here, there]))

    def _join(self, meeting: Meeting, trajectory: Trajectory) -> None:
        """Go over to the world of the left map, and take it in."""
        left = meeting.left
        self.left.remove(left)
        self._grower.tested = left.tested
        with self._map.lock:
            move_world(self._map, meeting.into_left)
            ahead = take_in(self._map, self._places, left.map, left.places)
            trajectory.join(left.trajectory, ahead)
        self._adjuster.believe(self._adjuster.nuisances)
        self._closer.join_window(np.unique(meeting.fix.seen.point) + ahead)
        self._adjuster.adjust_coarsely()
        self._grower.adjust_all()
