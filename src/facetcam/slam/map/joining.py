"""Maps that move: in parts where a loop bends them, or into the world of another, which they then take in."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from facetcam.geometry import se3
from facetcam.slam.map.map import Map
from facetcam.slam.map.places import Places

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Similarity:
    """Maps x to `growth * R x + t`, with T = (R, t).

    Attributes
    ----------
    T : (4, 4) array
    growth : float
    """

    T: Array
    growth: float

    @classmethod
    def between(cls, T_there_rig: Array, T_here_rig: Array, growth: float) -> Self:
        """From the world of one map, here, into that of another, by the poses of one rig in both."""
        R = T_there_rig[:3, :3] @ T_here_rig[:3, :3].T
        t = T_there_rig[:3, 3] - growth * R @ T_here_rig[:3, 3]
        return cls(se3.from_rotation_translation(R, t), growth)

    def points(self, xyz: Array) -> Array:
        """Move points (N, 3)."""
        return se3.transform(self.T, self.growth * xyz)

    def steps(self, tangent: Array) -> Array:
        """Move steps (N, 3, M) between points."""
        return np.asarray(self.growth * (self.T[:3, :3] @ tangent))

    def pose(self, T_world_rig: Array) -> Array:
        """Move a pose (4, 4); a rig keeps its size."""
        R = self.T[:3, :3] @ T_world_rig[:3, :3]
        return se3.from_rotation_translation(R, self.points(T_world_rig[None, :3, 3])[0])


def move_world(map: Map, into: Similarity) -> None:
    """Move a map into another world."""
    points = map.points
    points.xyz[:], points.tangent[:] = into.points(points.xyz), into.steps(points.tangent)
    for keyframe in map.keyframes:
        keyframe.T_world_rig = into.pose(keyframe.T_world_rig)
        keyframe.grow(into.growth)


def move_map(map: Map, T_world_rig: Array, growth: Array) -> None:
    """Move keyframes to new poses, and points with the keyframe that saw them first."""
    points = map.points
    reference = np.full(len(points), -1)
    for keyframe in reversed(map.keyframes):
        reference[keyframe.observations.point] = keyframe.index
    for keyframe, T, factor in zip(map.keyframes, T_world_rig, growth):
        rows = np.flatnonzero(reference == keyframe.index)
        local = se3.transform(se3.inverse(keyframe.T_world_rig), points.xyz[rows])
        turn = T[:3, :3] @ keyframe.T_world_rig[:3, :3].T
        points.xyz[rows] = se3.transform(T, factor * local)
        points.tangent[rows] = factor * (turn @ points.tangent[rows])
        keyframe.T_world_rig = T
        keyframe.grow(float(factor))


def take_in(map: Map, places: Places, earlier: Map, earlier_places: Places) -> int:
    """Add an earlier map of the same world; returns by how much larger the ids of its points are now.

    Its keyframes come first. What they and ours have in common is not joined yet, and nothing but sight joins
    them: wheels tell nothing of the way from one map to the other.
    """
    ahead, first = map.points.join(earlier.points), len(earlier.keyframes)
    for keyframe in earlier.keyframes:
        keyframe.observations.point = keyframe.observations.point + ahead
        keyframe.handovers = replace(keyframe.handovers, point=keyframe.handovers.point + ahead)
    for keyframe in map.keyframes:
        keyframe.index += first
    map.keyframes[0].odometry = None
    map.keyframes = earlier.keyframes + map.keyframes
    map.number, map.since = earlier.number, first + map.since
    places.join(earlier_places, ahead, first)
    return ahead
