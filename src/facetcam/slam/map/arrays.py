"""A map as plain arrays, and back: living points, keyframes with what they saw, and the index of places."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from facetcam.slam.camera.edges import patch_edges
from facetcam.slam.camera.frame import Corners
from facetcam.slam.camera.optics import Optics
from facetcam.slam.map.checking import check
from facetcam.slam.map.map import Keyframe, Map, Observations
from facetcam.slam.map.places import Places, Sightings

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Arrays = dict[str, NDArray[Any]]

POINTS = ("xyz", "patch", "offset", "tangent", "jacobian", "descriptor", "colour", "predicted", "found")
LATER = ("repeated",)  # not in the first maps


def to_arrays(map: Map, places: Places) -> Arrays:
    """Copy all that is needed to go on with a map; dead points are left out and the others renumbered."""
    alive = np.flatnonzero(map.points.alive)
    new_id = np.full(len(map.points), -1, np.int64)
    new_id[alive] = np.arange(len(alive))
    arrays: Arrays = {f"points.{name}": getattr(map.points, name)[alive] for name in (*POINTS, *LATER)}
    arrays["camera.creep"] = map.creep
    return arrays | _keyframes(map) | _observations(map, new_id) | _sightings(map, places, new_id)


def _keyframes(map: Map) -> Arrays:
    keyframes = map.keyframes
    nothing = np.full(3, np.nan)
    wheels = [nothing if k.odometry is None else k.odometry for k in keyframes]
    return {
        "keyframes.timestamp": np.array([k.timestamp for k in keyframes], np.float64),
        "keyframes.T_world_rig": map.poses(),
        "keyframes.odometry": np.array(wheels, np.float64).reshape(-1, 3),
        "keyframes.measured": np.array([k.measured for k in keyframes], np.int32),
        "keyframes.session": np.array([k.session for k in keyframes], np.int32),
        "keyframes.velocity": np.array([k.velocity for k in keyframes], np.float64).reshape(-1, 6),
    }


def _observations(map: Map, new_id: Index) -> Arrays:
    rows = [new_id[k.observations.point] >= 0 for k in map.keyframes]
    seen = [k.observations for k in map.keyframes]
    return {
        "observations.keyframe": np.repeat(np.arange(len(rows)), [int(r.sum()) for r in rows]),
        "observations.point": _joined([new_id[s.point[r]] for s, r in zip(seen, rows)], np.int64, ()),
        "observations.view": _joined([s.view[r] for s, r in zip(seen, rows)], np.int8, ()),
        # Measurements are made in float32.
        "observations.pixels": _joined([s.pixels[r] for s, r in zip(seen, rows)], np.float32, (2,)),
    }


def _sightings(map: Map, places: Places, new_id: Index) -> Arrays:
    known = places.sightings
    for keyframe in map.keyframes[places.indexed :]:
        known = known.joined(Sightings.of(keyframe))
    known = known.take(new_id[known.point] >= 0)
    return {
        "sightings.point": new_id[known.point],
        "sightings.keyframe": known.keyframe,
        "sightings.descriptor": known.descriptor,
    }


def _joined(parts: list[NDArray[Any]], dtype: Any, shape: tuple[int, ...]) -> NDArray[Any]:
    return np.concatenate([np.empty((0, *shape), dtype), *parts]).astype(dtype)


def from_arrays(arrays: Arrays, map: Map, places: Places, optics: Optics) -> None:
    """Fill an empty map and an empty index.

    Raises
    ------
    ValueError
        If the arrays contradict each other, or are none of a map.
    """
    check(arrays, map.points, optics.n_views)
    n_keyframes = len(arrays["keyframes.timestamp"])
    known = [*POINTS, *(name for name in LATER if f"points.{name}" in arrays)]
    columns = {name: arrays[f"points.{name}"] for name in known}
    edge = patch_edges(columns["patch"], columns["offset"], columns["jacobian"])
    map.points.extend(**columns, edge=edge)
    if "camera.creep" in arrays:  # not in the first maps
        map.creep = arrays["camera.creep"].copy()
        optics.creep_to(map.creep)
    map.keyframes.extend(_keyframe(arrays, k, optics) for k in range(n_keyframes))
    seen = Sightings(*(arrays[f"sightings.{column}"] for column in ("point", "keyframe", "descriptor")))
    places.restore(seen, n_keyframes)


def _keyframe(arrays: Arrays, k: int, optics: Optics) -> Keyframe:
    wheels = arrays["keyframes.odometry"][k]
    keyframe = Keyframe(
        k,
        float(arrays["keyframes.timestamp"][k]),
        arrays["keyframes.T_world_rig"][k],
        Corners.none(),
        None,
        wheels if np.all(np.isfinite(wheels)) else None,
        measured=int(arrays["keyframes.measured"][k]),
        session=int(arrays["keyframes.session"][k]),
    )
    if "keyframes.velocity" in arrays:  # not in the first maps
        keyframe.velocity = arrays["keyframes.velocity"][k].copy()
    first, last = np.searchsorted(arrays["observations.keyframe"], [k, k + 1])
    view = arrays["observations.view"][first:last]
    pixels = arrays["observations.pixels"][first:last].astype(np.float64)
    keyframe.observations = Observations(
        arrays["observations.point"][first:last], view, pixels, optics.plane(pixels, view)
    )
    return keyframe
