"""Where the rig is in the map: patches near a prediction, or descriptors without one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from facetcam.geometry import se3
from facetcam.slam.camera.blank import blank_views
from facetcam.slam.camera.corner_finder import CornerFinder
from facetcam.slam.camera.frame import Frame
from facetcam.slam.camera.optics import Optics
from facetcam.slam.camera.pose import judged_pose, refine_pose
from facetcam.slam.camera.shutter import at_one_moment
from facetcam.slam.camera.sight import Sights
from facetcam.slam.config import SlamConfig
from facetcam.slam.map.map import WIDE, Keyframe, Map
from facetcam.slam.map.measure import Measurements, Predictions, measure, predict, thin
from facetcam.slam.map.points import Points
from facetcam.slam.relative_pose.doubt import refuting_motion
from facetcam.slam.relative_pose.pairs import Pairs, match_corners
from facetcam.slam.tracking.fix import Fix, beside, better, likelier
from facetcam.slam.tracking.flow import pose_by_flow
from facetcam.slam.tracking.joint_pose import JointSight
from facetcam.slam.tracking.relocaliser import Relocaliser

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_NEAR_KEYFRAMES = 10
AT_REST = np.zeros(6)
_NONE = np.empty(0, np.int64)
_SAME = (0.003, 0.01)  # radians and metres by which one pose may come out differently
_LOOKS = 4  # at most
_LEAST_AGREEMENT = 0.4  # share of the measurements that must fit a pose


class Tracker:
    """Finds the pose of frames in the map.

    Parameters
    ----------
    map : Map
    optics : Optics
    config : SlamConfig
    corners : CornerFinder
    relocaliser : Relocaliser
    """

    def __init__(
        self, map: Map, optics: Optics, config: SlamConfig, corners: CornerFinder, relocaliser: Relocaliser
    ) -> None:
        self._map = map
        self._optics = optics
        self._config = config
        self._corners = corners
        self._relocaliser = relocaliser
        self._last: tuple[Frame, Measurements, Points] | None = None

    def find(self, frame: Frame, *predicted: Array, velocity: Array = AT_REST) -> Fix | None:
        """Pose of a frame near one of its predictions, the likeliest first; there may be none.

        `velocity` is the right-hand twist (6,) a second while the shutter rolls.

        Where patches agree poorly the last frame's points are followed by their flow, more of the map is
        tried, and the descriptors are asked too, first near the prediction, then at the places of the map
        that look like the frame.
        """
        best = None
        for T_world_rig in predicted:
            best = better(best, self.locate(frame, T_world_rig, velocity=velocity))
            if best is not None and best.sure:
                return best
        moved = self._followed(frame, *predicted[:1])
        best = self._or_moved(best, moved, frame, velocity)
        if best is not None and best.clear:
            return best
        if best is None:
            for T_world_rig in predicted:
                wide = self._map.points_around(T_world_rig[:3, 3])
                best = better(best, self.locate(frame, T_world_rig, wide, velocity))
        return likelier(best, self._relocate(frame, velocity, *predicted[:1]))

    def held(self, frame: Frame, predicted: Array, velocity: Array) -> Fix | None:
        """A pose that few points hold, and corners of the last keyframe besides that have no depth yet.

        A view that is swept empty shows little of the map; what comes in has no place in it so soon.
        """
        last, config, optics = self._map.keyframes[-1], self._config, self._optics
        expected, seen, sights = self._sighted(frame, predicted, None, velocity)
        pairs = match_corners(last.corners, self._corners(frame), config)
        T = JointSight(last.T_world_rig, sights, pairs, optics, config).held_pose(predicted)
        if T is None:
            return None
        pose = judged_pose(T, sights, optics, config.pixel_sigma)
        fix = Fix(pose, expected, seen.take(pose.residuals < config.gate))
        return fix if fix.borne_out else None

    def confirmed(self, frame: Frame, fix: Fix, velocity: Array) -> Fix | None:
        """A pose that the corners of the last keyframe do not refute, or else the one that they show.

        A map that is bent, or looks alike elsewhere, draws poses astray, and grows there; from frame to frame
        corners need no map. None where no pose stands.
        """
        last, corners = self._map.keyframes[-1], self._corners(frame)
        pairs = match_corners(last.corners, corners, self._config)
        T_last_new = se3.inverse(last.T_world_rig) @ fix.T_world_rig
        another = refuting_motion(pairs, T_last_new, self._optics)
        if another is None:
            return fix
        self._last = None
        own, length = (float(np.linalg.norm(T[:3, 3])) for T in (T_last_new, another))
        another[:3, 3] *= own / max(length, 1e-9)  # lengths are what corners tell worst
        found = self.locate(frame, last.T_world_rig @ another, velocity=velocity)
        if found is not None and not self._refuted(found, last, pairs):
            return found
        leaning = self._leaning(fix, last, pairs)
        return None if leaning is None or self._refuted(leaning, last, pairs) else leaning

    def _refuted(self, fix: Fix, last: Keyframe, pairs: Pairs) -> bool:
        T_last_new = se3.inverse(last.T_world_rig) @ fix.T_world_rig
        return refuting_motion(pairs, T_last_new, self._optics) is not None

    def _leaning(self, fix: Fix, last: Keyframe, pairs: Pairs) -> Fix | None:
        """A fix at the pose that the corners of the last keyframe bear out, too, if there is one."""
        near, seen, optics = fix.T_world_rig, fix.seen, self._optics
        sights = self._map.points.sights(seen.point, seen.view, seen.plane, near, optics)
        T = JointSight(last.T_world_rig, sights, pairs, optics, self._config).agreed_pose(near)
        if T is None:
            return None
        return replace(fix, pose=judged_pose(T, sights, optics, self._config.pixel_sigma))

    def record(self, frame: Frame, fix: Fix) -> None:
        """Count what was expected and what was found, by which unreliable points are known."""
        self._last = (frame, fix.seen, self._map.points)
        np.add.at(self._map.points.predicted, fix.predictions.point, 1)
        np.add.at(self._map.points.found, fix.seen.point, 1)

    def _local_points(self, T_world_rig: Array) -> Index:
        """Points of the keyframes nearest in space, whatever their heading, and of the latest ones."""
        near: dict[int, Keyframe] = {k.index: k for k in self._map.near(T_world_rig[:3, 3], _NEAR_KEYFRAMES)}
        near |= {k.index: k for k in self._map.keyframes[-self._config.window :]}
        return self._map.observed_points(list(near.values()))

    def _points_in_sight(self, T_world_rig: Array) -> Index:
        """Points of the keyframes around that saw most of what the last frame has seen.

        What one view has left behind enters another much later, far from where it was mapped.
        """
        if self._last is None or self._last[2] is not self._map.points:
            return _NONE
        around = self._map.near(T_world_rig[:3, 3], WIDE)
        return self._map.observed_points(self._map.covisible(self._last[1].point, around)[:_NEAR_KEYFRAMES])

    def locate(
        self, frame: Frame, predicted: Array, ids: Index | None = None, velocity: Array = AT_REST
    ) -> Fix | None:
        """Pose from map points, or some of them, whose patches are aligned near their predictions."""
        config = self._config
        expected, seen, sights = self._sighted(frame, predicted, ids, velocity)
        if len(seen) < config.min_inliers:
            return None
        pose = refine_pose(predicted, sights, self._optics, config.pixel_sigma)
        fits = pose.residuals < config.gate
        if fits.sum() < config.min_inliers or fits.mean() < _LEAST_AGREEMENT:
            return None
        fix = Fix(pose, expected, seen.take(fits))
        return fix if fix.borne_out else None

    def _sighted(
        self, frame: Frame, predicted: Array, ids: Index | None, velocity: Array
    ) -> tuple[Predictions, Measurements, Sights]:
        """What counts as expected with a pose, and what is found near it.

        Points from farther away may be hidden by now, and blank views show none: only those that are found
        count as expected.
        """
        points, config = self._map.points, self._config
        near = self._local_points(predicted) if ids is None else ids
        far = self._points_in_sight(predicted) if ids is None else _NONE
        is_near, wanted = np.zeros((2, len(points)), dtype=bool)
        is_near[near], wanted[near], wanted[far] = True, True, True
        expected = predict(points, np.flatnonzero(wanted), predicted, self._optics)
        around = [*self._map.near(predicted[:3, 3], WIDE), *self._map.keyframes[-config.window :]]
        expected = expected.take(self._map.unmistakable(expected.point, expected.view, around))
        expected = thin(expected, points, config.measured_points // self._optics.n_views)
        seen, found = measure(frame, expected, points, self._optics, config)
        blank = blank_views(frame, self._optics)
        expected = expected.take(found | (is_near[expected.point] & ~blank[expected.view]))
        xyz, readout = points.xyz[seen.point], self._map.readout
        plane = at_one_moment(predicted, velocity, xyz, seen.view, seen.pixels, readout, self._optics)
        return expected, seen, points.sights(seen.point, seen.view, plane, predicted, self._optics)

    def locate_from_afar(
        self, frame: Frame, guess: Array, ids: Index | None = None, velocity: Array = AT_REST
    ) -> Fix | None:
        """The same where the first pose is a guess: looks again from what it led to while more agrees.

        Patches align poorly where they are not expected, and the pose stays centimetres off.
        """
        fix = self.locate(frame, guess, ids, velocity)
        for _ in range(_LOOKS):
            again = None if fix is None else self.locate(frame, fix.T_world_rig, ids, velocity)
            if better(fix, again) is fix:
                break
            fix = again
        return fix

    def _or_moved(self, near: Fix | None, moved: Array | None, frame: Frame, velocity: Array) -> Fix | None:
        """Of a pose near its prediction and the one to which points have moved, that with which more agrees.

        From a prediction patches miss some of what is there; so where the two differ both get a second look.
        """
        if moved is None or (near is not None and beside(near.T_world_rig, moved, _SAME)):
            return near
        other = self.locate(frame, moved, velocity=velocity)
        if near is not None and other is not None and not beside(near.T_world_rig, other.T_world_rig, _SAME):
            near, other = (
                better(fix, self.locate(frame, fix.T_world_rig, velocity=velocity)) for fix in (near, other)
            )
        return better(near, other)

    def _followed(self, frame: Frame, *predicted: Array) -> Array | None:
        """Pose to which the points of the frame before have moved."""
        if not predicted or self._last is None:
            return None
        before, seen, points = self._last
        if points is not self._map.points:  # that map was forgotten
            return None
        xyz = points.xyz[seen.point]
        return pose_by_flow(before, seen, xyz, frame, predicted[0], self._optics, self._config)

    def _relocate(self, frame: Frame, velocity: Array, *predicted: Array) -> Fix | None:
        """Pose from corner descriptors: the first that the patches confirm clearly, else the best.

        Where the rig should be it need not be sharp: a floor that repeats is, a piece further.
        """
        best = None
        for T in self._relocaliser.propose(frame, *predicted):
            fix = self.locate_from_afar(frame, T, velocity=velocity)
            expected = fix is not None and any(beside(fix.T_world_rig, p) for p in predicted)
            if fix is not None and fix.clear and (fix.sharp or expected):
                return fix
            best = better(best, fix)
        return best
