"""When a tracked frame is worth keeping."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from facetcam.geometry import se3
from facetcam.slam.config import SlamConfig
from facetcam.slam.map.map import Keyframe, Map
from facetcam.slam.tracking.fix import Fix

Array = NDArray[np.float64]

_CANDIDATES = 30
_LEAST_NEWS = 0.4  # distance from the nearest keyframe below which people who walk seem to stand
_NEWS_AT_LAST = 0.2  # and where few points are left that hold a pose
_FEW = 3  # times the points that a pose needs


def nearest_keyframe(map: Map, fix: Fix, config: SlamConfig) -> tuple[Keyframe, float]:
    """The keyframe that stood and looked most as a frame does, and how far the frame is from it.

    The distance is one where motion against the depth of the scene, or the turn, asks for a new keyframe. In
    a place that is mapped already it stays below, whenever its keyframes were made.
    """
    near = map.near(fix.T_world_rig[:3, 3], _CANDIDATES)
    xyz = map.points.xyz[fix.seen.point]
    depth = float(np.median(np.linalg.norm(xyz - fix.T_world_rig[:3, 3], axis=1)))
    T = se3.inverse(np.array([k.T_world_rig for k in near])) @ fix.T_world_rig
    moved = np.linalg.norm(T[:, :3, 3], axis=1) / (config.keyframe_parallax * depth)
    cosine = 0.5 * (np.trace(T[:, :3, :3], axis1=1, axis2=2) - 1.0)
    turned = np.arccos(np.clip(cosine, -1.0, 1.0)) / config.keyframe_angle
    distance = np.maximum(moved, turned)
    best = int(np.argmin(distance))
    return near[best], float(distance[best])


def is_due(fix: Fix, nearest: Keyframe, distance: float, config: SlamConfig) -> bool:
    """New points are due away from all keyframes, and where fewer points are found than at the nearest.

    They are due early where the map has few in sight, the more so where few of these are found: the next step
    may lose them. In the dark few are found of many, and what a keyframe would add there is noise.
    """
    few = len(fix.seen) < _FEW * config.min_inliers
    news = distance > (_NEWS_AT_LAST if few else _LEAST_NEWS)
    scarce = len(fix.predictions) < config.keyframe_points and news
    return distance > 1.0 or len(fix.seen) < config.keyframe_overlap * nearest.measured or scarce
