"""What others want of a map: its cloud, what each keyframe saw, and the file that holds all of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from facetcam.errors import FacetcamError, MapError
from facetcam.io.colmap_model import RigFrame
from facetcam.rig import Rig
from facetcam.slam.camera.optics import Optics
from facetcam.slam.map.arrays import from_arrays, to_arrays
from facetcam.slam.map.file import MapHeader, read_map, require_rig, write_map
from facetcam.slam.map.map import Map
from facetcam.slam.map.places import Places

Array = NDArray[np.float64]


def coloured_cloud(map: Map) -> tuple[Array, NDArray[np.uint8]]:
    """World positions (M, 3) and RGB colours (M, 3) of the living points."""
    with map.lock:
        points = map.points
        return points.xyz[points.alive].copy(), points.colour[points.alive].copy()


def sightings_of_keyframes(map: Map) -> list[RigFrame]:
    """What the keyframes saw of the living points, numbered as in `coloured_cloud`."""
    with map.lock:
        alive = map.points.alive
        row = np.cumsum(alive) - 1
        frames = []
        for keyframe in map.keyframes:
            seen = keyframe.observations
            kept = alive[seen.point]
            point = row[seen.point[kept]]
            frames.append(
                RigFrame(keyframe.timestamp, keyframe.T_world_rig, seen.view[kept], point, seen.pixels[kept])
            )
        return frames


def load(path: Path | str, rig: Rig, map: Map, places: Places, optics: Optics) -> MapHeader:
    """Fill an empty map and an empty index from a file; raises MapError where it cannot be used."""
    header, arrays = read_map(path)
    require_rig(path, header, rig)
    try:
        from_arrays(arrays, map, places, optics)
    except (KeyError, ValueError, TypeError, FacetcamError) as error:
        raise MapError(f"{path}: its parts contradict each other ({error}); map again") from error
    return header


def save(
    path: Path | str, rig: Rig, map: Map, places: Places, metric: bool, scale_sigma: float, loops: int
) -> None:
    """Write a map as one file, in place of an older one; raises OutputError where it cannot."""
    with map.lock:
        arrays = to_arrays(map, places)
        sessions = 1 + max((k.session for k in map.keyframes), default=-1)
    write_map(Path(path), MapHeader.of(rig, arrays, sessions, metric, scale_sigma, loops), arrays)
