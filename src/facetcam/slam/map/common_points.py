"""Points that two maps have in common, or two parts of one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from facetcam.slam.map.map import Keyframe, Map
from facetcam.slam.map.measure import Measurements
from facetcam.slam.map.places import Places

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_SAME_PIXELS = 1.5
_LEAST_PAIRS = 10


def pairs_at_same_pixels(keyframe: Keyframe, seen: Measurements) -> tuple[Index, Index]:
    """Ids of the keyframe's points, and of other points measured within a pixel or so in the same view."""
    own = keyframe.observations
    if not len(own) or not len(seen):
        return np.empty(0, np.int64), np.empty(0, np.int64)
    distance, nearest = (np.asarray(a) for a in cKDTree(own.pixels).query(seen.pixels))
    point = own.point[nearest]
    same = (distance < _SAME_PIXELS) & (own.view[nearest] == seen.view) & (point != seen.point)
    new, first = np.unique(point[same], return_index=True)
    return new, seen.point[same][first]


def growth_between(
    keyframe: Keyframe, T_there_rig: Array, seen: Measurements, xyz_here: Array, xyz_there: Array
) -> float | None:
    """How much larger an old map is than a new one, from points that both have at the same pixels.

    Parameters
    ----------
    keyframe : Keyframe
        Of the new map.
    T_there_rig : (4, 4) array
        Its pose in the old one.
    seen : Measurements
        What it has seen of that one, under ids that are rows of `xyz_there`.
    xyz_here, xyz_there : (N, 3), (M, 3) arrays
        Points of both maps, which may be one.

    Returns
    -------
    float or None
        None where too few tell.
    """
    new, old = pairs_at_same_pixels(keyframe, seen)
    if len(new) < _LEAST_PAIRS:
        return None
    there = np.linalg.norm(xyz_there[old] - T_there_rig[:3, 3], axis=1)
    here = np.linalg.norm(xyz_here[new] - keyframe.T_world_rig[:3, 3], axis=1)
    return float(np.median(there / here))


def merge_points(map: Map, places: Places, new: Index, old: Index) -> None:
    """Let points `new` (sorted ids) be the points `old`: all that saw the one saw the other."""
    kept = ~np.isin(old, new)
    new, old = new[kept], old[kept]
    if not len(new):
        return
    for keyframe in map.keyframes:
        seen = keyframe.observations
        where = np.minimum(np.searchsorted(new, seen.point), len(new) - 1)
        hit = new[where] == seen.point
        if hit.any():
            seen.point[hit] = old[where[hit]]
            _, first = np.unique(seen.point * 128 + seen.view, return_index=True)
            seen.keep(np.isin(np.arange(len(seen)), first))
    map.points.alive[new] = False
    places.replace_points(new, old)
