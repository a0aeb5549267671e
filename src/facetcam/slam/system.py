"""Visual SLAM through mirrors: one frame in, one state out."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from facetcam.errors import FacetcamError
from facetcam.features import match_windowed
from facetcam.geometry import se3
from facetcam.rig import Rig
from facetcam.slam.config import SlamConfig
from facetcam.slam.frame import CornerFinder, Frame, make_frame
from facetcam.slam.map import Keyframe, Map
from facetcam.slam.mapping import Mapper
from facetcam.slam.measure import Measurements, Predictions, measure, predict, thin
from facetcam.slam.odometry import planar_motion, planar_pose
from facetcam.slam.optics import Optics
from facetcam.slam.pose import Pose, generalized_pose, refine_pose
from facetcam.slam.scale import scale_sigma
from facetcam.slam.start import MIN_MATCHES, START_GATE, Pairs, enough_parallax, estimate_motion, match_corners
from facetcam.slam.state import State, Status, ViewHealth

Array = NDArray[np.float64]

_NEAR_KEYFRAMES = 10
_MAX_WAITING = 40
_CLEAR_FIX = 0.5  # share of the predictions that a good pose confirms
_FIRST_GLOBAL = 5  # keyframes
_GLOBAL_GROWTH = 1.5
_IN_SIGHT = 0.25  # share of corners matched, below which the first frame can no longer start the map


@dataclass(slots=True)
class _Tracked:
    """A frame of the trajectory: its pose hangs on a keyframe, and follows when the map is adjusted."""

    timestamp: float
    keyframe: Keyframe
    T_keyframe_rig: Array
    scale: float  # of the keyframe at that time

    @property
    def T_world_rig(self) -> Array:
        T = self.T_keyframe_rig.copy()
        T[:3, 3] *= self.keyframe.scale / self.scale
        return self.keyframe.T_world_rig @ T


@dataclass(slots=True)
class _Fix:
    """A pose with the measurements that gave it."""

    pose: Pose
    predictions: Predictions
    seen: Measurements


class Slam:
    """Tracks a mirror rig and maps what it sees.

    Parameters
    ----------
    rig : Rig
    config : SlamConfig

    Examples
    --------
    >>> slam = Slam(Rig.load("rig.yaml"))
    >>> for frame in source:
    ...     state = slam.track(frame.image, frame.timestamp)
    >>> slam.finish()
    >>> timestamps, poses = slam.trajectory()
    """

    def __init__(self, rig: Rig, config: SlamConfig | None = None) -> None:
        self.rig = rig
        self.config = config or SlamConfig()
        self.scale_sigma = np.inf
        self.timing: dict[str, list[float]] = defaultdict(list)
        self._optics = Optics(rig, self.config.seam_margin)
        self._corners = CornerFinder(self._optics, self.config.features)
        self._map = Map()
        self._mapper = Mapper(self._map, self._optics, self.config, self._corners)
        self._tracked: list[_Tracked] = []
        self._waiting: list[tuple[Frame, Array | None]] = []  # frames before the map
        self._T_world_rig = np.eye(4)
        self._step = np.eye(4)  # motion between the last two frames
        self._odometry: Array | None = None
        self._last_timestamp = -np.inf
        self._lost = False
        self._frames_since_keyframe = 0
        self._keyframe_inliers = 0
        self._next_global = _FIRST_GLOBAL

    def track(self, image: NDArray[np.generic], timestamp: float, odometry: ArrayLike | None = None) -> State:
        """Take one raw frame and tell where the rig is.

        Parameters
        ----------
        image : (H, W) or (H, W, 3) array of uint8 or uint16
            Raw frame, grey or BGR, of the size of the rig's camera.
        timestamp : float
            Seconds, later than the one before.
        odometry : (3,) array, optional
            x, y in metres and yaw in radians in a drifting frame; the robot's x axis is the rig's +y.

        Returns
        -------
        State

        Raises
        ------
        FacetcamError
            If the frame does not fit the rig or the time does not increase.
        """
        if not timestamp > self._last_timestamp:
            raise FacetcamError(f"timestamp {timestamp} does not come after {self._last_timestamp}; sort the frames")
        with self._timed("frame"):
            frame = make_frame(image, timestamp, self.rig.size)
        self._last_timestamp = timestamp
        wheels = None if odometry is None else np.asarray(odometry, dtype=np.float64)
        if not self._map.keyframes or len(self._map.points) == 0:
            state = self._start(frame, wheels)
        else:
            state = self._follow(frame, wheels)
        self._odometry = wheels
        return state

    def _follow(self, frame: Frame, odometry: Array | None) -> State:
        """Predict, measure the map in every view, solve the pose, and grow the map where it is due."""
        predicted = self._predict(odometry)
        with self._timed("track"):
            fix = self._locate(frame, predicted)
            if fix is None or len(fix.seen) < _CLEAR_FIX * len(fix.predictions):
                # A poor prediction lets patches settle on look-alikes: ask the descriptors too.
                fix = max(fix, self._relocate(frame, predicted), key=lambda f: len(f.seen) if f else 0)
        if fix is None:
            return self._dead_reckon(frame, predicted, odometry)
        self._accept(fix, frame.timestamp)
        keyframe = self._wants_keyframe(fix)
        if keyframe:
            with self._timed("map"):
                self._add_keyframe(frame, fix.pose.T_world_rig, fix.seen, odometry, self.config.gate)
        return self._state(frame, fix, keyframe)

    def _predict(self, odometry: Array | None) -> Array:
        """Odometry where there is some, else the last motion once more."""
        if odometry is not None and self._odometry is not None:
            return self._T_world_rig @ planar_motion(self._odometry, odometry, 0.0)[0]
        return self._T_world_rig @ self._step

    def _local_points(self, T_world_rig: Array) -> NDArray[np.int64]:
        near = {k.index: k for k in self._map.near(T_world_rig[:3, 3], _NEAR_KEYFRAMES)}
        near |= {k.index: k for k in self._mapper.window}
        return self._map.observed_points(list(near.values()))

    def _locate(self, frame: Frame, predicted: Array) -> _Fix | None:
        """Pose from map points whose patches are aligned near their predictions."""
        points, config = self._map.points, self.config
        expected = predict(points, self._local_points(predicted), predicted, self._optics)
        expected = thin(expected, points, config.measured_points // self._optics.n_views)
        seen, _ = measure(frame, expected, points, self._optics, config)
        if len(seen) < config.min_inliers:
            return None
        pose = refine_pose(
            predicted, points.xyz[seen.point], seen.view, seen.plane, self._optics, config.pixel_sigma
        )
        inliers = pose.residuals < config.gate
        if inliers.sum() < config.min_inliers or inliers.mean() < 0.4:
            return None
        return _Fix(pose, expected, seen.take(inliers))

    def _relocate(self, frame: Frame, predicted: Array) -> _Fix | None:
        """Pose from corner descriptors: first near their predictions, then anywhere in the map."""
        corners = self._corners(frame)
        for rows, candidates in self._matches(frame, predicted):
            plane = self._optics.plane(corners.pixels[rows], corners.views[rows])
            T, inliers = generalized_pose(
                self._map.points.xyz[candidates], corners.views[rows], plane, self._optics, self.config.gate * 2
            )
            if T is not None and inliers.sum() >= self.config.min_inliers:
                fix = self._locate(frame, T)
                if fix is not None:
                    return fix
        return None

    def _matches(
        self, frame: Frame, predicted: Array
    ) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64]]]:
        """Corner rows with the map points that look like them."""
        points, config = self._map.points, self.config
        corners = self._corners(frame)
        expected = predict(points, self._local_points(predicted), predicted, self._optics)
        hits = match_windowed(
            points.descriptor[expected.point],
            expected.pixels,
            expected.view,
            corners.descriptors,
            corners.pixels,
            corners.views,
            radius=config.search_radius * self.rig.camera.width,
            max_distance=config.match_distance,
            ratio=config.match_ratio,
        )
        rows = hits >= 0
        yield hits[rows].astype(np.int64), expected.point[rows]
        from facetcam.features import match_mutual

        alive = np.flatnonzero(points.alive)
        pairs = match_mutual(
            corners.descriptors, points.descriptor[alive], config.match_ratio, config.match_distance
        )
        yield pairs[:, 0].astype(np.int64), alive[pairs[:, 1]]

    def _accept(self, fix: _Fix, timestamp: float) -> None:
        points = self._map.points
        np.add.at(points.predicted, fix.predictions.point, 1)
        np.add.at(points.found, fix.seen.point, 1)
        T = fix.pose.T_world_rig
        self._step = np.eye(4) if self._lost else se3.inverse(self._T_world_rig) @ T
        self._lost = False
        self._T_world_rig = T
        self._remember(timestamp, T)
        self._frames_since_keyframe += 1

    def _remember(self, timestamp: float, T_world_rig: Array) -> None:
        keyframe = self._map.keyframes[-1]
        T = se3.inverse(keyframe.T_world_rig) @ T_world_rig
        self._tracked.append(_Tracked(timestamp, keyframe, T, keyframe.scale))

    def _wants_keyframe(self, fix: _Fix) -> bool:
        """New views need points: after enough motion against the depth, a turn, or lost measurements."""
        config, last = self.config, self._map.keyframes[-1]
        T = se3.inverse(last.T_world_rig) @ fix.pose.T_world_rig
        xyz = self._map.points.xyz[fix.seen.point]
        depth = float(np.median(np.linalg.norm(xyz - fix.pose.T_world_rig[:3, 3], axis=1)))
        moved = np.linalg.norm(T[:3, 3]) > config.keyframe_parallax * depth
        turned = np.linalg.norm(se3.log(T)[:3]) > config.keyframe_angle
        thinned = len(fix.seen) < config.keyframe_overlap * self._keyframe_inliers
        return bool(moved or turned or (thinned and self._frames_since_keyframe > 1))

    def _add_keyframe(
        self, frame: Frame, T_world_rig: Array, seen: Measurements, odometry: Array | None, gate: float
    ) -> Keyframe:
        keyframe = self._mapper.insert(frame, T_world_rig, seen, odometry, gate)
        if len(self._map.keyframes) >= self._next_global:
            self._adjust_all()
        self._T_world_rig = keyframe.T_world_rig
        self._frames_since_keyframe = 0
        self._keyframe_inliers = len(keyframe.observations)
        return keyframe

    def _adjust_all(self) -> None:
        """Adjust the whole map, since a window freezes the scale of its past, and judge the scale.

        It is done whenever the map has grown by a fixed share, so that its cost a frame stays bounded.
        """
        self._mapper.adjust_all()
        bundle = self._mapper.whole_bundle()
        if bundle is not None:
            self.scale_sigma = scale_sigma(bundle, self._optics, self.config.pixel_sigma)
        self._next_global = int(_GLOBAL_GROWTH * len(self._map.keyframes)) + 1

    def _dead_reckon(self, frame: Frame, predicted: Array, odometry: Array | None) -> State:
        """No pose from the images: follow the wheels, or say that the rig is lost."""
        self._lost = True
        if odometry is None or self._odometry is None:
            return State(frame.timestamp, Status.LOST, map_points=self._n_points)
        self._T_world_rig = predicted
        self._remember(frame.timestamp, predicted)
        return State(frame.timestamp, Status.DEAD_RECKONING, predicted, map_points=self._n_points)

    def _start(self, frame: Frame, odometry: Array | None) -> State:
        """Wait for a pair of frames that can start the map; nothing is said of a motion that is not seen."""
        self._waiting = [*self._waiting[-_MAX_WAITING:], (frame, odometry)]
        while len(self._waiting) > 1:
            first, wheels = self._waiting[0]
            pairs = match_corners(self._corners(first), self._corners(frame), self.config)
            T = self._first_motion(pairs, wheels, frame, odometry)
            if T is not None:
                with self._timed("map"):
                    return self._first_map(first, wheels, frame, odometry, T)
            if len(pairs) >= max(MIN_MATCHES, _IN_SIGHT * len(self._corners(first))):
                break
            self._waiting.pop(0)  # out of sight
        pose = None if odometry is None else planar_pose(odometry)
        return State(frame.timestamp, Status.STARTING, pose)

    def _first_motion(self, pairs: Pairs, wheels: Array | None, frame: Frame, odometry: Array | None) -> Array | None:
        if wheels is None or odometry is None:
            return estimate_motion(pairs, self._optics)
        T, _ = planar_motion(wheels, odometry, 0.0)
        a, b = self._corners(self._waiting[0][0]), self._corners(frame)
        return T if enough_parallax(a, b, T, self._optics, self.config) else None

    def _first_map(
        self, first: Frame, wheels: Array | None, frame: Frame, odometry: Array | None, T_first_rig: Array
    ) -> State:
        """Make the first two keyframes, then find the frames that waited between them."""
        origin = np.eye(4) if wheels is None else planar_pose(wheels)
        nothing = Measurements(np.empty(0, np.int64), np.empty(0, np.int8), np.empty((0, 2)), np.empty((0, 2)))
        self._add_keyframe(first, origin, nothing, wheels, START_GATE)
        self._remember(first.timestamp, origin)
        keyframe = self._add_keyframe(frame, origin @ T_first_rig, nothing, odometry, START_GATE)
        if self._n_points < MIN_MATCHES // 2:
            return self._start_again(frame, odometry)
        for waiting, _ in self._waiting[1:-1]:
            fix = self._locate(waiting, self._interpolated(waiting.timestamp)) or self._relocate(
                waiting, self._T_world_rig
            )
            if fix is not None:
                self._remember(waiting.timestamp, fix.pose.T_world_rig)
        self._step = se3.inverse(self._interpolated(self._waiting[-2][0].timestamp)) @ keyframe.T_world_rig
        self._waiting = []
        self._remember(frame.timestamp, keyframe.T_world_rig)
        self._T_world_rig = keyframe.T_world_rig
        return State(frame.timestamp, Status.TRACKING, keyframe.T_world_rig, keyframe=True, map_points=self._n_points)

    def _start_again(self, frame: Frame, odometry: Array | None) -> State:
        """The pair gave no map after all: forget it, and wait for a better one."""
        self._map.clear()
        self._tracked.clear()
        return State(frame.timestamp, Status.STARTING, None if odometry is None else planar_pose(odometry))

    def _interpolated(self, timestamp: float) -> Array:
        """Pose between the first two keyframes."""
        a, b = self._map.keyframes[0], self._map.keyframes[-1]
        share = (timestamp - a.timestamp) / (b.timestamp - a.timestamp)
        return a.T_world_rig @ se3.exp(share * se3.log(se3.inverse(a.T_world_rig) @ b.T_world_rig))

    def _state(self, frame: Frame, fix: _Fix, keyframe: bool) -> State:
        expected = np.bincount(fix.predictions.view, minlength=self._optics.n_views)
        inliers = np.bincount(fix.seen.view, minlength=self._optics.n_views)
        health = {n: ViewHealth(int(e), int(i)) for n, e, i in zip(self._optics.names, expected, inliers)}
        return State(
            timestamp=frame.timestamp,
            status=Status.TRACKING,
            T_world_rig=self._T_world_rig.copy(),
            covariance=fix.pose.covariance,
            views=health,
            keyframe=keyframe,
            metric=self.metric,
            scale_sigma=self.scale_sigma,
            map_points=self._n_points,
            pixels=fix.seen.pixels.astype(np.float32),
            pixel_views=fix.seen.view,
        )

    def finish(self) -> None:
        """Adjust the whole map once more and judge its scale."""
        with self._timed("finish"):
            self._adjust_all()

    @property
    def metric(self) -> bool:
        """True where the images prove the scale of the map."""
        return self.scale_sigma < self.config.metric_sigma

    @property
    def _n_points(self) -> int:
        return int(np.count_nonzero(self._map.points.alive))

    @property
    def keyframe_poses(self) -> Array:
        """Poses (K, 4, 4) of the keyframes."""
        return np.array([k.T_world_rig for k in self._map.keyframes]).reshape(-1, 4, 4)

    def trajectory(self) -> tuple[Array, Array]:
        """Timestamps (N,) and best current poses (N, 4, 4) of all frames that have one, in time order."""
        frames = sorted(self._tracked, key=lambda t: t.timestamp)
        poses = [f.T_world_rig for f in frames]
        return np.array([f.timestamp for f in frames]), np.array(poses).reshape(-1, 4, 4)

    def cloud(self) -> tuple[Array, NDArray[np.uint8]]:
        """World positions (M, 3) and RGB colours (M, 3) of the map points."""
        points = self._map.points
        return points.xyz[points.alive].copy(), points.colour[points.alive].copy()

    @contextmanager
    def _timed(self, stage: str) -> Iterator[None]:
        start = time.perf_counter()
        yield
        self.timing[stage].append(time.perf_counter() - start)
