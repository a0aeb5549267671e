"""New map points, where the rays of matching corners meet."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from facetcam.geometry import se3
from facetcam.geometry.triangulation import triangulate_two_rays
from facetcam.slam.camera.optics import Optics
from facetcam.slam.camera.sight import across, linearise_sight
from facetcam.slam.config import SlamConfig
from facetcam.slam.map.map import Keyframe, Map
from facetcam.slam.map.measure import measure, predict
from facetcam.slam.relative_pose.epipolar import match_across_views, match_along_epipolars

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class Triangulator:
    """Gives free corners of keyframes a place in the map, and finds it in the other views.

    Parameters
    ----------
    map : Map
    optics : Optics
    config : SlamConfig
    """

    def __init__(self, map: Map, optics: Optics, config: SlamConfig) -> None:
        self._map = map
        self._optics = optics
        self._config = config

    def in_time(self, new: Keyframe, old: Keyframe, gate: float) -> None:
        """Match the free corners of two keyframes and add those whose rays meet as map points."""
        a, b = np.flatnonzero(new.free), np.flatnonzero(old.free)
        T_new_old = se3.inverse(new.T_world_rig) @ old.T_world_rig
        a, b = match_along_epipolars(
            new.corners, a, old.corners, b, T_new_old, gate, self._optics, self._config
        )
        self._add(new, a, old, b, gate)

    def across_views(self, keyframe: Keyframe) -> None:
        """Match the free corners of views that overlap, which have a depth though the rig stands or turns."""
        if not self._optics.overlapping:
            return
        free = np.flatnonzero(keyframe.free)
        a, b = match_across_views(keyframe.corners, free, self._optics, self._config)
        self._add(keyframe, a, keyframe, b, self._config.gate)

    def _add(self, new: Keyframe, a: Index, old: Keyframe, b: Index, gate: float) -> None:
        """Add those pairs of corners as map points whose rays meet, and which look alike."""
        xyz, consistent = self._meet(new, a, old, b, gate)
        a, b, xyz = a[consistent], b[consistent], xyz[consistent]
        ids, kept = self._map.add_points(xyz, new, a, self._optics)
        a, b = a[kept], b[kept]
        told = self._told(ids, new, a, old, b)
        self._map.points.alive[ids[~told]] = False
        ids, a, b = ids[told], a[told], b[told]
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

    def _told(self, ids: Index, new: Keyframe, a: Index, old: Keyframe, b: Index) -> NDArray[np.bool_]:
        """Points whose distance the older keyframe tells: on an edge, what lies across it does."""
        xyz, views = self._map.points.xyz[ids], old.corners.views[b]
        origins = se3.transform(new.T_world_rig, self._optics.origins(new.corners.views[a]))
        seen = self._map.points.sights(ids, views, old.corners.plane[b], old.T_world_rig, self._optics)
        by_rig = linearise_sight(old.T_world_rig, *seen[:3], self._optics)[1]
        by_distance = np.einsum("nij,nj->ni", by_rig, (xyz - origins) @ old.T_world_rig[:3, :3])
        told = np.linalg.norm(across(seen.edge, by_distance), axis=1) / self._optics.focal
        return np.asarray(told > self._config.min_parallax)

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

    def refind(self, keyframe: Keyframe, other: Keyframe) -> None:
        """Look for a keyframe's points in all views of another one whose images are kept."""
        if other.frame is None:
            return
        ids = np.unique(keyframe.observations.point)
        predictions = predict(self._map.points, ids, other.T_world_rig, self._optics)
        seen = (predictions.point, predictions.view)
        sought = ~other.observations.has(*seen) & self._map.unmistakable(*seen, [keyframe])
        predictions = predictions.take(sought)
        found, hit = measure(other.frame, predictions, self._map.points, self._optics, self._config)
        near = np.linalg.norm(found.pixels - predictions.pixels[hit], axis=1) < self._config.gate
        found = found.take(near)
        other.observations.append(found.point, found.view, found.pixels, found.plane)
