"""Growing the map: new keyframes and new points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from facetcam.geometry import se3
from facetcam.slam.adjustment.adjuster import Adjuster
from facetcam.slam.camera.corner_finder import CornerFinder
from facetcam.slam.camera.frame import Corners, Frame
from facetcam.slam.camera.optics import Optics
from facetcam.slam.config import SlamConfig
from facetcam.slam.map.map import Keyframe, Map
from facetcam.slam.map.measure import Measurements, predict
from facetcam.slam.mapping.triangulator import Triangulator
from facetcam.slam.odometry.planar import planar_motion
from facetcam.slam.relative_pose.doubt import is_denied, views_aside
from facetcam.slam.relative_pose.pairs import Pairs, match_corners
from facetcam.slam.scale.handovers import Handovers
from facetcam.slam.scale.search import better_scale, found_elsewhere, rescale
from facetcam.slam.tracking.joint_pose import JointSight

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_NONE = np.empty(0, np.int64)
_OCCUPIED = 5.0  # px round an observed point in which no new one is made
_UNTOLD = 3  # times as many images as the window's are kept until hand-overs tell the scale
_PARTNERS = 4  # keyframes against which a new one is triangulated


class Mapper:
    """Turns tracked frames into keyframes, and keyframes into map points.

    Parameters
    ----------
    map : Map
    optics : Optics
    config : SlamConfig
    corners : CornerFinder
    adjuster : Adjuster

    Attributes
    ----------
    denied : bool
        More views contradict the motion that led to the last keyframe of a young map than bear it out.
    """

    def __init__(
        self, map: Map, optics: Optics, config: SlamConfig, corners: CornerFinder, adjuster: Adjuster
    ) -> None:
        self._map = map
        self._optics = optics
        self._config = config
        self._corners = corners
        self._adjuster = adjuster
        self._triangulator = Triangulator(map, optics, config)
        self.handovers = Handovers(map, optics, config, adjuster)
        self.session = 0
        self.denied = False

    def insert(
        self,
        frame: Frame,
        T_world_rig: Array,
        seen: Measurements,
        odometry: Array | None,
        gate: float,
        aside: Index = _NONE,
    ) -> Keyframe:
        """Make a keyframe, give its free corners a depth, and adjust the window around it.

        Views set `aside` give no points.
        """
        lock = self._map.lock
        corners = self._corners(frame)
        with lock:
            keyframe = self._new_keyframe(frame, T_world_rig, corners, odometry)
            keyframe.observations.append(seen.point, seen.view, seen.pixels, seen.plane)
            keyframe.measured = len(seen)
            self._occupy(keyframe)
            window = self._adjuster.window
            self._doubt(keyframe, window[:-1])
            keyframe.free &= ~np.isin(keyframe.corners.views, aside)
        for partner in reversed(window[-1 - _PARTNERS : -1]):
            if partner.frame is not None:
                with lock:
                    self._triangulator.in_time(keyframe, partner, gate)
        with lock:
            self._triangulator.across_views(keyframe)
        for other in window:
            with lock:
                self._triangulator.refind(keyframe, other)
        self._adjuster.adjust_window()
        with lock:
            self._map.drop_unproven(self._map.keyframes[: -self._config.window][-1:], window)
        self._forget_images()
        return keyframe

    def _new_keyframe(
        self, frame: Frame, T_world_rig: Array, corners: Corners, odometry: Array | None
    ) -> Keyframe:
        index = len(self._map.keyframes)
        keyframe = Keyframe(index, frame.timestamp, T_world_rig, corners, frame, odometry)
        keyframe.session = self.session
        keyframe.free = np.ones(len(corners), dtype=bool)
        self._map.keyframes.append(keyframe)
        return keyframe

    def _occupy(self, keyframe: Keyframe) -> None:
        """Corners beside a map point, seen or expected, make no second one."""
        from scipy.spatial import cKDTree

        known = self._map.observed_points(self._adjuster.window)
        expected = predict(self._map.points, known, keyframe.T_world_rig, self._optics)
        taken = np.concatenate([keyframe.observations.pixels, expected.pixels])
        if len(taken) and len(keyframe.corners):
            distance, _ = cKDTree(taken).query(keyframe.corners.pixels)
            keyframe.free &= distance > _OCCUPIED

    def _doubt(self, keyframe: Keyframe, others: list[Keyframe]) -> None:
        """Corners of a view that contradicts the rig's motion since the last keyframe give no points.

        Where few points hold a pose it may as well be that one which is wrong.
        """
        if not others:
            return
        last = others[-1]
        pairs = match_corners(last.corners, keyframe.corners, self._config)
        aside = self._views_aside(keyframe, last, pairs)
        if len(aside):
            aside = self._reconciled(keyframe, last, pairs, aside)
        wheels = None
        if last.odometry is not None and keyframe.odometry is not None:
            wheels = planar_motion(last.odometry, keyframe.odometry, 0.0)[0]
        T_last_new = se3.inverse(last.T_world_rig) @ keyframe.T_world_rig
        self.denied = self._map.young and is_denied(pairs, T_last_new, self._optics, wheels)
        keyframe.free &= ~np.isin(keyframe.corners.views, aside)

    def _views_aside(self, keyframe: Keyframe, last: Keyframe, pairs: Pairs) -> Index:
        return views_aside(pairs, se3.inverse(last.T_world_rig) @ keyframe.T_world_rig, self._optics)

    def _reconciled(self, keyframe: Keyframe, last: Keyframe, pairs: Pairs, aside: Index) -> Index:
        """Go over to the pose of points and corners together if fewer views contradict it; tells which do."""
        before, seen = keyframe.T_world_rig, keyframe.observations
        if not len(seen):
            return aside
        sights = self._map.points.sights(seen.point, seen.view, seen.plane, before, self._optics)
        T = JointSight(last.T_world_rig, sights, pairs, self._optics, self._config).agreed_pose(before)
        if T is None:
            return aside
        keyframe.T_world_rig = T
        left = self._views_aside(keyframe, last, pairs)
        if len(left) < len(aside):
            return left
        keyframe.T_world_rig = before
        return aside

    def drop(self, rows: NDArray[np.bool_]) -> None:
        """Drop some of the points (N,), and adjust the window without them."""
        if rows.any():
            self._map.points.alive[rows] = False
            self._adjuster.adjust_window()

    def seek_scale(self) -> None:
        """Go over to another scale where the views bear it out far better than the present one."""
        window, lock = self._adjuster.window, self._map.lock
        factor = better_scale(found_elsewhere(self._map, window, self._optics, self._config))
        if factor is None:
            return
        with lock:
            rescale(self._map, factor, self._optics)
        self._adjuster.adjust_coarsely()
        for keyframe in window:
            for other in window:
                with lock:
                    self._triangulator.refind(keyframe, other)

    def _forget_images(self) -> None:
        """Only the window needs them, and a map whose scale has not been told yet."""
        kept = self._config.window * (1 if self.handovers.tell else _UNTOLD)
        leaving = [k for k in self._map.keyframes[:-kept] if k.frame is not None]
        if leaving:
            self.handovers.seek(leaving)
        for keyframe in leaving:
            keyframe.frame = None
