"""Where in the map a frame was taken, without any idea beforehand."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from facetcam.features import match_windowed
from facetcam.slam.camera.corner_finder import CornerFinder
from facetcam.slam.camera.frame import Corners, Frame
from facetcam.slam.camera.optics import Optics
from facetcam.slam.camera.pose import generalized_pose
from facetcam.slam.config import SlamConfig
from facetcam.slam.map.map import Map
from facetcam.slam.map.measure import predict
from facetcam.slam.map.places import Places, Sightings, match_points

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_CANDIDATES = 4  # places tried in a frame
_PLACE = 12  # keyframes that make up a place, at most
AGREEING = 7  # corners that agree on a pose worth a look: the patches will tell
_REACH = 0.3  # of the best score, which a keyframe of the same place has


class Relocaliser:
    """Proposes poses for frames: places that look alike, then one pose of all views from matched points.

    Parameters
    ----------
    map : Map
    optics : Optics
    config : SlamConfig
    corners : CornerFinder
    places : Places
    """

    def __init__(
        self, map: Map, optics: Optics, config: SlamConfig, corners: CornerFinder, places: Places
    ) -> None:
        self._map = map
        self._optics = optics
        self._config = config
        self._corners = corners
        self._places = places

    def propose(self, frame: Frame, *predicted: Array) -> Iterator[Array]:
        """Poses (4, 4) of the rig that many corners agree on: near predictions, then where it looks alike."""
        corners = self._corners(frame)
        for near in predicted:
            pose = self._near(corners, near)
            if pose is not None:
                yield pose
        if len(corners) < self._config.min_inliers:
            return
        for sightings in self._likely(corners):
            pose, matched = self.solve(corners, sightings)
            if pose is not None and matched >= AGREEING:
                yield pose

    def _near(self, corners: Corners, predicted: Array) -> Array | None:
        """Pose from corners that look like map points expected near them."""
        points, config = self._map.points, self._config
        expected = predict(points, self._map.points_around(predicted[:3, 3]), predicted, self._optics)
        hits = match_windowed(
            points.descriptor[expected.point],
            expected.pixels,
            expected.view,
            corners.descriptors,
            corners.pixels,
            corners.views,
            radius=config.search_radius * self._optics.camera.width,
            max_distance=config.match_distance,
            ratio=config.match_ratio,
        )
        matched = hits >= 0
        pose, agreeing = self._agreed(corners, hits[matched], expected.point[matched])
        return pose if agreeing >= AGREEING else None

    def _likely(self, corners: Corners) -> Iterator[Sightings]:
        """What was seen at the places that resemble the frame, those of the last keyframes first."""
        yield self._recent()
        n = len(self._map.keyframes)
        score = self._places.resembling(corners.descriptors, n, self._config.match_distance)
        for group in self.groups(score)[:_CANDIDATES]:
            yield self._places.of_keyframes(group)

    def _recent(self) -> Sightings:
        """Points of the keyframes that are not indexed yet, as they looked when they were found."""
        ids = self._map.observed_points(self._map.keyframes[self._places.indexed :])
        return Sightings(ids, np.full(len(ids), -1), self._map.points.descriptor[ids])

    def groups(self, score: Array) -> list[Index]:
        """Keyframes by place, best place first: a keyframe draws in those that share most of its points."""
        score = score.copy()
        groups: list[Index] = []
        while len(groups) < _CANDIDATES and score.max(initial=0.0) > 0.0:
            best = int(np.argmax(score))
            near = self._map.near(self._map.keyframes[best].T_world_rig[:3, 3], _PLACE)
            group = np.array([k.index for k in near if score[k.index] >= _REACH * score[best]])
            groups.append(group)
            score[[k.index for k in near]] = 0.0
        return groups

    def solve(self, corners: Corners, sightings: Sightings) -> tuple[Array | None, int]:
        """Pose of a frame from corners that look like known points, and how many agree on it."""
        config = self._config
        sightings = sightings.take(self._map.points.alive[sightings.point])
        rows, points = match_points(corners.descriptors, sightings, config.match_ratio, config.match_distance)
        return self._agreed(corners, rows, points)

    def _agreed(self, corners: Corners, rows: NDArray[np.integer], points: Index) -> tuple[Array | None, int]:
        """Pose from rows of the corners as points of the map, and how many agree on it."""
        seen = (self._map.points.xyz[points], corners.views[rows], corners.plane[rows])
        T, inliers = generalized_pose(*seen, self._optics, 2.0 * self._config.gate)
        return T, int(inliers.sum())
