"""Loops: the way comes back to a place that was mapped earlier, and the map is made to agree with itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeGuard

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from facetcam.geometry import se3
from facetcam.slam.camera.frame import Corners, Frame
from facetcam.slam.camera.optics import Optics
from facetcam.slam.config import SlamConfig
from facetcam.slam.map.common_points import growth_between, merge_points, pairs_at_same_pixels
from facetcam.slam.map.joining import move_map
from facetcam.slam.map.map import Keyframe, Map, shared_points
from facetcam.slam.map.measure import measure, predict
from facetcam.slam.map.places import Places
from facetcam.slam.map.pose_graph import Edges, relax
from facetcam.slam.tracking.fix import Fix
from facetcam.slam.tracking.relocaliser import Relocaliser
from facetcam.slam.tracking.tracker import AT_REST, Tracker

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_AWAY = 2  # windows of keyframes after which a place is an old one
_RETURNED = 30  # old points that are seen again where a loop closes
_TIED = 30  # points that two keyframes share to be tied in the pose graph
_ALIKE = 0.3  # of the best score, which an old place has that is worth a look
_CLOSING_WEIGHT = 5.0
_LOST_WEIGHT = 0.1  # of a way that no points have measured, but wheels
_DRIFT = 0.1  # of the way since an old place, by which a map is off there at most
_LOST_DRIFT = 0.5  # and where its scale drifts too, or wheels alone have measured a part of the way
_NEARBY = 0.3  # metres by which it may be off in any case


@dataclass(frozen=True, slots=True)
class Loop:
    """A return to an old place.

    Attributes
    ----------
    keyframe, old : int
        Where it was noticed, and the keyframe that saw the place earlier.
    points : int
        Old points seen again.
    gap : float
        Distance between where the map put the rig and where the old place does; 0 where tracking had found
        the old points itself.
    """

    keyframe: int
    old: int
    points: int
    gap: float


class LoopCloser:
    """Looks for old places at each keyframe, and closes the loop.

    Parameters
    ----------
    map, optics, config, places, relocaliser, tracker
        The parts of the system.
    """

    def __init__(
        self,
        map: Map,
        optics: Optics,
        config: SlamConfig,
        places: Places,
        relocaliser: Relocaliser,
        tracker: Tracker,
    ) -> None:
        self._map = map
        self._optics = optics
        self._config = config
        self._places = places
        self._relocaliser = relocaliser
        self._tracker = tracker
        self._last = -np.inf  # keyframe of the last loop

    def close(self, keyframe: Keyframe, metric: bool) -> Loop | None:
        """Close a loop at a new keyframe where there is one.

        Tracking may have found the old points itself; else the place is recognised, its pose verified by
        patches, and the keyframes between are bent by a pose graph. The caller adjusts the map afterwards.

        Only mapping may call this: nothing else changes what is read here. The lock is held where the map is
        changed, so that tracking goes on while the rest is computed.
        """
        if not self._is_away(keyframe) or keyframe.frame is None:
            return None
        loop = self._tracked(keyframe) or self._recognised(keyframe, metric)
        if loop is not None:
            self._last = keyframe.index
        return loop

    def ends_in_a_loop(self) -> bool:
        """Tell whether the last keyframes together see old points again, though none saw enough by itself.

        A film may end so; the last adjustment of the map closes the loop.
        """
        keyframes, last = self._map.keyframes, self._map.keyframes[-self._config.window :]
        if not last or not self._is_away(last[-1]):
            return False
        first_recent = self._first_recent(last[0])
        old = self._map.observed_points(keyframes[:first_recent])
        recent = self._map.observed_points(keyframes[first_recent : last[0].index])
        again = np.intersect1d(self._map.observed_points(last), np.setdiff1d(old, recent))
        if len(again) < _RETURNED:
            return False
        self._last = last[-1].index
        return True

    def forget(self) -> None:
        """Begin with another map."""
        self._last = -np.inf

    def recognised(self, frame: Frame, corners: Corners, velocity: Array = AT_REST) -> Fix | None:
        """Pose in this map of a frame that is no part of it, where patches confirm it."""
        score = self._places.resembling(
            corners.descriptors, len(self._map.keyframes), self._config.match_distance
        )
        groups = self._relocaliser.groups(score)
        fixes = (self._verified(frame, corners, velocity, group) for group in groups)
        return next((fix for fix in fixes if fix is not None), None)

    def recognised_near(self, T_world_rig: Array, frame: Frame, velocity: Array) -> Fix | None:
        """The same near a pose that others foretell, which sharp patches confirm, or several views."""
        fix = self._tracker.locate(frame, T_world_rig, velocity=velocity)
        return fix if _returned(fix) and (fix.sharp or fix.witnesses > 1) else None

    def join_window(self, ids: Index) -> None:
        """Observe old points in the last keyframes, and let new ones at the same pixels be these."""
        for keyframe in self._map.keyframes[-self._config.window :]:
            with self._map.lock:
                self._join(keyframe, ids)
        self._last = len(self._map.keyframes) - 1

    @property
    def _away(self) -> int:
        return _AWAY * self._config.window

    def _is_away(self, keyframe: Keyframe) -> bool:
        """Tell whether the last loop was closed long ago."""
        return keyframe.index - self._last >= self._away

    def _first_recent(self, keyframe: Keyframe) -> int:
        return max(keyframe.index - self._away, self._map.since)

    def _tracked(self, keyframe: Keyframe) -> Loop | None:
        """Old points that no keyframe has seen for long are seen again."""
        keyframes, first_recent = self._map.keyframes, self._first_recent(keyframe)
        recent = self._map.observed_points(keyframes[first_recent : keyframe.index])
        back = np.setdiff1d(keyframe.observations.point, recent)
        if len(back) < _RETURNED:
            return None
        shared = [int(np.isin(k.observations.point, back).sum()) for k in keyframes[:first_recent]]
        if max(shared, default=0) < _RETURNED // 2:
            return None
        return Loop(keyframe.index, int(np.argmax(shared)), len(back), 0.0)

    def _recognised(self, keyframe: Keyframe, metric: bool) -> Loop | None:
        """Find the keyframe at an old place that it does not know to be at."""
        assert keyframe.frame is not None
        for group in self._old_places(keyframe):
            fix = self._verified(keyframe.frame, keyframe.corners, keyframe.velocity, group)
            if fix is not None and self._within_drift(keyframe, group, fix, metric):
                return self._close(keyframe, group, fix, metric)
        return None

    def _old_places(self, keyframe: Keyframe) -> list[Index]:
        """Groups of keyframes that look alike, away in time and without common points."""
        config, n = self._config, len(self._map.keyframes)
        score = self._places.resembling(keyframe.corners.descriptors, n, config.match_distance)
        best = score.max(initial=0.0)
        score[self._first_recent(keyframe) :] = 0.0
        for other in self._map.keyframes[: len(score)]:
            alike = score[other.index] >= _ALIKE * best
            if not alike or shared_points(keyframe, other) >= self._config.min_inliers:
                score[other.index] = 0.0
        return self._relocaliser.groups(score)

    def _verified(self, frame: Frame, corners: Corners, velocity: Array, group: Index) -> Fix | None:
        """Pose of a frame from the points of an old place alone, where patches confirm it."""
        T, matched = self._relocaliser.solve(corners, self._places.of_keyframes(group))
        if T is None or matched < self._config.min_inliers:
            return None
        ids = self._map.observed_points([self._map.keyframes[k] for k in group])
        fix = self._tracker.locate_from_afar(frame, T, ids, velocity)
        return fix if _returned(fix) and fix.sharp and fix.likely else None

    def _within_drift(self, keyframe: Keyframe, group: Index, fix: Fix, metric: bool) -> bool:
        """Tell whether the map can be as far off as an old place says: what repeats looks alike elsewhere."""
        centres = self._map.poses()[int(group.min()) : keyframe.index + 1, :3, 3]
        way = float(np.linalg.norm(np.diff(centres, axis=0), axis=1).sum())
        share = _DRIFT if metric and not self._map.since else _LOST_DRIFT
        return _gap(keyframe, fix) < _NEARBY + share * way

    def _close(self, keyframe: Keyframe, group: Index, fix: Fix, metric: bool) -> Loop:
        """Bend the keyframes until the old and the new sight of the place agree, and join their points."""
        keyframes = self._map.keyframes
        shared = [int(np.isin(keyframes[k].observations.point, fix.seen.point).sum()) for k in group]
        old = int(group[np.argmax(shared)])
        gap, growth = _gap(keyframe, fix), 1.0 if metric else self._growth(keyframe, fix)
        poses = self._map.poses()
        i, j, weight = self._ties()
        edges = Edges.between(i, j, poses, weight).plus(
            old, keyframe.index, se3.inverse(poses[old]) @ fix.T_world_rig, growth, _CLOSING_WEIGHT
        )
        bent = relax(poses, edges, with_scale=not metric)
        with self._map.lock:
            move_map(self._map, *bent)
        self.join_window(np.unique(fix.seen.point))
        return Loop(keyframe.index, old, len(fix.seen), gap)

    def _growth(self, keyframe: Keyframe, fix: Fix) -> float:
        """How much larger the old map is than the new one, from points that both have at the same pixels."""
        xyz = self._map.points.xyz
        return growth_between(keyframe, fix.T_world_rig, fix.seen, xyz, xyz) or 1.0

    def _ties(self) -> tuple[Index, Index, Array]:
        """Pairs of keyframes that follow each other or share many points, and how stiffly they are tied."""
        seen = [np.unique(k.observations.point) for k in self._map.keyframes]
        columns = np.concatenate(seen)
        start = np.cumsum([0, *(len(s) for s in seen)])
        sight = csr_matrix((np.ones(len(columns), np.int32), columns, start))
        common = (sight @ sight.T).todok()
        tied = {(i, j) for (i, j), count in common.items() if i < j and count >= _TIED}
        i, j = np.array(sorted(tied | {(k, k + 1) for k in range(len(seen) - 1)}), np.int64).reshape(-1, 2).T
        lost = [common[pair] < self._config.min_inliers for pair in zip(i, j)]
        return i, j, np.where(lost, _LOST_WEIGHT, 1.0)

    def _join(self, keyframe: Keyframe, ids: Index) -> None:
        """Observe old points in a keyframe, and merge the new points that lie at the same pixels."""
        if keyframe.frame is None:
            return
        expected = predict(self._map.points, ids, keyframe.T_world_rig, self._optics)
        expected = expected.take(~keyframe.observations.has(expected.point, expected.view))
        seen, _ = measure(keyframe.frame, expected, self._map.points, self._optics, self._config)
        new, old = pairs_at_same_pixels(keyframe, seen)
        keyframe.observations.append(seen.point, seen.view, seen.pixels, seen.plane)
        merge_points(self._map, self._places, new, old)


def _gap(keyframe: Keyframe, fix: Fix) -> float:
    """Metres between where the map put a keyframe and where an old place does."""
    return float(np.linalg.norm(fix.T_world_rig[:3, 3] - keyframe.T_world_rig[:3, 3]))


def _returned(fix: Fix | None) -> TypeGuard[Fix]:
    return fix is not None and len(fix.seen) >= _RETURNED
