"""Which scale the views bear out: what one view has mapped must be found in the others.

A map of a wrong scale keeps the few sightings in other views that happen to fit it, and these confirm it. So
before a scale is believed others are tried, each as a prediction of its own.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from facetcam.geometry import se3
from facetcam.slam.camera.optics import Optics
from facetcam.slam.config import SlamConfig
from facetcam.slam.map.map import Keyframe, Map, Observations
from facetcam.slam.map.measure import Predictions, measure, predict_at
from facetcam.slam.map.points import Points
from facetcam.slam.scale.evidence import home_views

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_FACTORS = np.geomspace(0.2, 5.0, 41)  # the middle one is the scale as it is
_KEYFRAMES = 4  # whose images are searched, at most
_POINTS = 300  # of each
_CLEARLY = 1.5  # times as many points must be found as at the present scale
_LEAST_FOUND = 30
_PEAK = 0.8  # of the best count


def home_of_points(map: Map) -> NDArray[np.int8]:
    """View (N,) that saw each map point most; -1 where none did."""
    seen = [Observations(), *(k.observations for k in map.keyframes)]
    point, view = np.concatenate([s.point for s in seen]), np.concatenate([s.view for s in seen])
    return home_views(view, point, len(map.points))


def homes(map: Map) -> tuple[NDArray[np.int8], Index]:
    """View (N,) that saw each map point most, and the first keyframe in which it did; -1 where none did."""
    views, first = home_of_points(map), np.full(len(map.points), -1)
    for keyframe in reversed(map.keyframes):
        at_home = keyframe.observations.view == views[keyframe.observations.point]
        first[keyframe.observations.point[at_home]] = keyframe.index
    return views, first


def found_elsewhere(map: Map, keyframes: list[Keyframe], optics: Optics, config: SlamConfig) -> Array:
    """How many points (F,) are found in other views than the one that saw them most, at each of the factors.

    Seen from the view that mapped it, a point of another scale lies elsewhere on the same ray.
    """
    views, counts = home_of_points(map), np.zeros(len(_FACTORS))
    for keyframe in [k for k in keyframes if k.frame is not None][-_KEYFRAMES:]:
        ids = map.observed_points([keyframe])
        ids = ids[:: 1 + len(ids) // _POINTS]
        expected, factor = expected_elsewhere(map.points, ids, views, keyframe, _FACTORS, optics)
        assert keyframe.frame is not None
        found, hit = measure(keyframe.frame, expected, map.points, optics, config)
        shift = np.linalg.norm(found.pixels - expected.pixels[hit], axis=1)
        counts += np.bincount(factor[hit][shift < config.gate], minlength=len(_FACTORS))
    return counts


def expected_elsewhere(
    points: Points, ids: Index, views: NDArray[np.int8], keyframe: Keyframe, factors: Array, optics: Optics
) -> tuple[Predictions, Index]:
    """Where some points would be seen by other views than the ones that saw them most, at other scales.

    Returns
    -------
    expected : Predictions
    factor : (M,) array
        Row of the scale of each.
    """
    centres = se3.transform(keyframe.T_world_rig, optics.origins(views[ids]))
    xyz = centres + factors[:, None, None] * (points.xyz[ids] - centres)
    tangent = factors[:, None, None, None] * points.tangent[ids]
    every, F = np.tile(ids, len(factors)), len(factors) * len(ids)
    expected, rows = predict_at(
        xyz.reshape(F, 3), tangent.reshape(F, 3, 2), points, every, keyframe.T_world_rig, optics
    )
    away = expected.view != views[expected.point]
    return expected.take(away), rows[away] // max(len(ids), 1)


def better_scale(counts: Array) -> float | None:
    """Factor at which far more points are found than at the present scale, if there is one."""
    best, present = counts.max(), counts[len(_FACTORS) // 2]
    if best < _LEAST_FOUND or best <= _CLEARLY * present:
        return None
    # Patches are drawn in from some pixels away, so the peak is flat: its middle counts.
    peak = _FACTORS[counts > _PEAK * best]
    return float(np.exp(np.median(np.log(peak))))


def rescale(map: Map, factor: float, optics: Optics) -> None:
    """Scale a map about its first keyframe; only sightings in the views that saw points most are kept."""
    views, first = homes(map)
    origin = map.keyframes[0].T_world_rig[:3, 3]
    for keyframe in map.keyframes:
        rows = np.flatnonzero(first == keyframe.index)
        T = keyframe.T_world_rig.copy()
        T[:3, 3] = origin + factor * (T[:3, 3] - origin)
        before, after = (se3.transform(P, optics.origins(views[rows])) for P in (keyframe.T_world_rig, T))
        map.points.xyz[rows] = after + factor * (map.points.xyz[rows] - before)
        map.points.tangent[rows] *= factor
        keyframe.T_world_rig = T
        keyframe.grow(factor)
        keyframe.observations.keep(keyframe.observations.view == views[keyframe.observations.point])
