"""Growing the map: new keyframes, new points, windowed adjustment, culling."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from facetcam.geometry import se3
from facetcam.geometry.triangulation import triangulate_two_rays
from facetcam.slam.bundle import Bundle, RelativePose, adjust
from facetcam.slam.config import SlamConfig
from facetcam.slam.epipolar import match_along_epipolars
from facetcam.slam.frame import CornerFinder, Frame
from facetcam.slam.map import Keyframe, Map
from facetcam.slam.measure import Measurements, measure, predict
from facetcam.slam.odometry import planar_motion
from facetcam.slam.optics import Optics

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_OCCUPIED = 5.0  # px round an observed point in which no new one is made
_LOCAL_STOP = (5, 1e-4)  # iterations, relative change of the cost
_GLOBAL_STOP = (30, 1e-6)  # the scale of a map converges slowly
_SCALE_HOLD = 0.3
_PARTNERS = 4  # keyframes against which a new one is triangulated
_MAX_FIXED = 10


class Mapper:
    """Turns tracked frames into keyframes, and keyframes into map points.

    Parameters
    ----------
    map : Map
    optics : Optics
    config : SlamConfig
    corners : CornerFinder
    """

    def __init__(self, map: Map, optics: Optics, config: SlamConfig, corners: CornerFinder) -> None:
        self._map = map
        self._optics = optics
        self._config = config
        self._corners = corners

    def insert(
        self, frame: Frame, T_world_rig: Array, seen: Measurements, odometry: Array | None, gate: float
    ) -> Keyframe:
        """Make a keyframe, give its free corners a depth, and adjust the window around it."""
        keyframe = self._new_keyframe(frame, T_world_rig, odometry)
        keyframe.observations.append(seen.point, seen.view, seen.pixels, seen.plane)
        self._occupy(keyframe)
        window = self.window
        for partner in reversed(window[-1 - _PARTNERS : -1]):
            self._triangulate(keyframe, partner, gate)
        self._refind(keyframe, window)
        self.adjust_window()
        self._forget_images()
        return keyframe

    @property
    def window(self) -> list[Keyframe]:
        """The keyframes that are adjusted together, oldest first."""
        return self._map.keyframes[-self._config.window :]

    def _new_keyframe(self, frame: Frame, T_world_rig: Array, odometry: Array | None) -> Keyframe:
        corners = self._corners(frame)
        index = len(self._map.keyframes)
        keyframe = Keyframe(index, frame.timestamp, T_world_rig, corners, frame, odometry)
        keyframe.free = np.ones(len(corners), dtype=bool)
        self._map.keyframes.append(keyframe)
        return keyframe

    def _occupy(self, keyframe: Keyframe) -> None:
        """Corners beside a map point, seen or expected, make no second one."""
        from scipy.spatial import cKDTree

        known = self._map.observed_points(self.window)
        expected = predict(self._map.points, known, keyframe.T_world_rig, self._optics)
        taken = np.concatenate([keyframe.observations.pixels, expected.pixels])
        if len(taken) and len(keyframe.corners):
            distance, _ = cKDTree(taken).query(keyframe.corners.pixels)
            keyframe.free &= distance > _OCCUPIED

    def _triangulate(self, new: Keyframe, old: Keyframe, gate: float) -> None:
        """Match the free corners of two keyframes and add those whose rays meet as map points."""
        a, b = np.flatnonzero(new.free), np.flatnonzero(old.free)
        T_new_old = se3.inverse(new.T_world_rig) @ old.T_world_rig
        a, b = match_along_epipolars(
            new.corners, a, old.corners, b, T_new_old, gate, self._optics, self._config
        )
        xyz, consistent = self._meet(new, a, old, b, gate)
        a, b, xyz = a[consistent], b[consistent], xyz[consistent]
        ids, kept = self._map.add_points(xyz, new, a, self._optics)
        a, b = a[kept], b[kept]
        confirmed = self._confirm(ids, old, old.corners.pixels[b], old.corners.views[b])
        self._map.points.alive[ids[~confirmed]] = False
        ids, a, b = ids[confirmed], a[confirmed], b[confirmed]
        new.free[a] = False
        old.free[b] = False
        corners = new.corners
        new.observations.append(ids, corners.views[a], corners.pixels[a], corners.plane[a])

    def _meet(
        self, new: Keyframe, a: Index, old: Keyframe, b: Index, gate: float
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Triangulate corner pairs, and tell which fit both images with enough parallax."""
        rays = []
        for keyframe, rows in ((new, a), (old, b)):
            views = keyframe.corners.views[rows]
            directions = self._optics.plane_rays(keyframe.corners.plane[rows], views)
            origins = se3.transform(keyframe.T_world_rig, self._optics.origins(views))
            rays += [origins, directions @ keyframe.T_world_rig[:3, :3].T]
        xyz, distance_a, distance_b, angle = triangulate_two_rays(*rays)
        good = (angle > self._config.min_parallax) & (distance_a > 0) & (distance_b > 0)
        for keyframe, rows in ((new, a), (old, b)):
            views = keyframe.corners.views[rows]
            points_rig = se3.transform(se3.inverse(keyframe.T_world_rig), xyz)
            plane, depth = self._optics.to_plane(points_rig, views)
            good &= (depth > 0) & (np.linalg.norm(plane - keyframe.corners.plane[rows], axis=1) < gate)
        return xyz, good

    def _confirm(
        self, ids: Index, old: Keyframe, pixels: Array, views: NDArray[np.int8]
    ) -> NDArray[np.bool_]:
        """Find new points by their patches in the older keyframe, and observe them there to sub-pixel."""
        assert old.frame is not None
        predictions = predict(self._map.points, ids, old.T_world_rig, self._optics)
        order = np.searchsorted(ids, predictions.point)
        predictions = predictions.take(predictions.view == views[order])
        order = np.searchsorted(ids, predictions.point)
        predictions.pixels = pixels[order]
        found, _ = measure(old.frame, predictions, self._map.points, self._optics, self._config)
        old.observations.append(found.point, found.view, found.pixels, found.plane)
        return np.isin(ids, found.point)

    def _refind(self, keyframe: Keyframe, window: list[Keyframe]) -> None:
        """Look for the keyframe's points in all views of the other keyframes whose images are kept."""
        ids = np.unique(keyframe.observations.point)
        for other in window:
            if other.frame is None:
                continue
            predictions = predict(self._map.points, ids, other.T_world_rig, self._optics)
            predictions = predictions.take(~other.observations.has(predictions.point, predictions.view))
            found, hit = measure(other.frame, predictions, self._map.points, self._optics, self._config)
            near = np.linalg.norm(found.pixels - predictions.pixels[hit], axis=1) < self._config.gate
            found = found.take(near)
            other.observations.append(found.point, found.view, found.pixels, found.plane)

    def adjust_window(self) -> None:
        """Adjust the window; older keyframes that share its points hold it in place."""
        window = self.window
        ids = self._map.observed_points(window)
        shared = [int(np.isin(k.observations.point, ids).sum()) for k in self._map.keyframes[: -len(window)]]
        anchors = [
            self._map.keyframes[i] for i in np.argsort(shared, kind="stable")[::-1][:_MAX_FIXED] if shared[i]
        ]
        anchors.sort(key=lambda k: k.index)
        self._adjust(anchors + window, len(anchors) or 1, ids, _LOCAL_STOP)

    def adjust_all(self) -> None:
        """Adjust every keyframe and point, the first keyframe held."""
        if len(self._map.keyframes) > 1:
            everything = self._map.observed_points(self._map.keyframes)
            self._adjust(self._map.keyframes, 1, everything, _GLOBAL_STOP)

    def whole_bundle(self) -> Bundle | None:
        """All keyframes and points as one problem, or None before there are any."""
        keyframes = self._map.keyframes
        ids = self._map.observed_points(keyframes)
        return self._bundle(keyframes, 1, ids) if len(ids) else None

    def _adjust(self, keyframes: list[Keyframe], n_fixed: int, ids: Index, stop: tuple[int, float]) -> None:
        bundle = self._bundle(keyframes, n_fixed, ids)
        if len(bundle.points) == 0:
            return
        poses, xyz = adjust(bundle, self._optics, 2.0 * self._config.pixel_sigma, *stop)
        growth = _growth(bundle, poses, xyz)
        self._map.points.xyz[self._used] = xyz
        for keyframe, T, factor in zip(keyframes, poses, growth):
            keyframe.T_world_rig = T
            keyframe.scale *= factor
        self._cull(keyframes, self._used)

    def _bundle(self, keyframes: list[Keyframe], n_fixed: int, ids: Index) -> Bundle:
        rows = [np.isin(k.observations.point, ids) for k in keyframes]
        point = np.concatenate([k.observations.point[r] for k, r in zip(keyframes, rows)])
        self._used, index = np.unique(point, return_inverse=True)
        fixed = np.arange(len(keyframes)) < n_fixed
        return Bundle(
            T_world_rig=np.stack([k.T_world_rig for k in keyframes]),
            fixed=fixed,
            points=self._map.points.xyz[self._used],
            frame=np.repeat(np.arange(len(keyframes)), [int(r.sum()) for r in rows]),
            view=np.concatenate([k.observations.view[r] for k, r in zip(keyframes, rows)]).astype(np.int64),
            point=index,
            plane=np.concatenate([k.observations.plane[r] for k, r in zip(keyframes, rows)]),
            motions=self._motions(keyframes, n_fixed),
        )

    def _motions(self, keyframes: list[Keyframe], n_fixed: int) -> list[RelativePose]:
        """Odometry between neighbours in time, and a loose hold on a scale that nothing else may hold."""
        motions = [_hold_scale(keyframes)] if n_fixed == 1 and len(keyframes) > 1 else []
        for j in range(max(1, n_fixed), len(keyframes)):
            a, b = keyframes[j - 1], keyframes[j]
            if b.index == a.index + 1 and a.odometry is not None and b.odometry is not None:
                T_a_b, covariance = planar_motion(a.odometry, b.odometry, self._config.odometry_sigma)
                motions.append(RelativePose(j - 1, j, T_a_b, covariance))
        return motions

    def _cull(self, keyframes: list[Keyframe], ids: Index) -> None:
        """Drop observations that do not fit, then points seen from one place only or rarely found."""
        points = self._map.points
        for keyframe in keyframes:
            seen = keyframe.observations
            points_rig = se3.transform(se3.inverse(keyframe.T_world_rig), points.xyz[seen.point])
            plane, depth = self._optics.to_plane(points_rig, seen.view)
            fits = (np.linalg.norm(plane - seen.plane, axis=1) < self._config.gate) & (depth > 0)
            seen.keep(fits & points.alive[seen.point])
        counts = np.bincount(
            np.concatenate([k.observations.point for k in keyframes]), minlength=len(points)
        )[ids]
        rare = (points.predicted[ids] > 8) & (points.found[ids] < 0.3 * points.predicted[ids])
        points.alive[ids[(counts < 2) | rare]] = False

    def _forget_images(self) -> None:
        for keyframe in self._map.keyframes[: -self._config.window]:
            keyframe.frame = None


def _hold_scale(keyframes: list[Keyframe]) -> RelativePose:
    """Keep the distance of the two ends to its present value within `_SCALE_HOLD`.

    Where the views determine the scale this is far too loose to matter; where they do not, the scale would
    run away.
    """
    T = se3.inverse(keyframes[0].T_world_rig) @ keyframes[-1].T_world_rig
    sigma = _SCALE_HOLD * max(float(np.linalg.norm(T[:3, 3])), 1e-3)
    return RelativePose(0, len(keyframes) - 1, T, np.diag([1.0, 1.0, 1.0, *(3 * [sigma**2])]))


def _growth(bundle: Bundle, T_world_rig: Array, points: Array) -> Array:
    """Factor (K,) by which an adjustment moved the points away from each keyframe, at the median."""
    before, after = (
        np.linalg.norm(xyz[bundle.point] - T[bundle.frame, :3, 3], axis=1)
        for xyz, T in ((bundle.points, bundle.T_world_rig), (points, T_world_rig))
    )
    ratio = after / np.maximum(before, 1e-9)
    rows = [ratio[bundle.frame == k] for k in range(len(T_world_rig))]
    return np.array([np.median(r) if len(r) else 1.0 for r in rows])
