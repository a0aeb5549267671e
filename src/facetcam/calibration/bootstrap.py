"""A rig from photos alone: one camera, plane mirrors, plain boards seen directly and in them.

Where a board seems to be behind a mirror does not depend on how its corners are named, so the lens and the
place of every sighting come first (Zhang's calibration, each sighting by itself). A mirror is a plane that
reflects one sighting of a photo onto another, in several photos. Then each photo is read: where does the
board stand, before all mirrors, so that chains of mirrors explain most of its sightings; this also settles
the order of the corners.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam.calibration.boards import BoardSet
from facetcam.calibration.bootstrap_lens import lens_and_places
from facetcam.calibration.bootstrap_planes import Plane, find_planes
from facetcam.calibration.bootstrap_reading import read_photo
from facetcam.calibration.sightings import Sighting
from facetcam.rig import Mirror, Rig, View

Array = NDArray[np.float64]

T_RIG_CAM = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])


def bootstrap(
    boards: BoardSet, sightings: Sequence[Sighting], size: tuple[int, int]
) -> tuple[Rig, list[Sighting]]:
    """Find lens, mirrors and views of a camera that sees boards directly and in plane mirrors.

    Parameters
    ----------
    boards : BoardSet
    sightings : sequence of Sighting
        Their views unknown; of plain chessboards also those whose order is open (`mirrored` None).
    size : (int, int)
        Width and height of the photos.

    Returns
    -------
    rig : Rig
        A start for `solve`: views `direct`, `left`, `right`, `left-right` ... where seen; unbounded mirrors;
        the rig frame is that of the camera (x right, y forward, z up).
    sightings : list of Sighting
        Those that the rig explains, with views, their corners in the order that the view's parity asks for.

    Raises
    ------
    FacetcamError
        If there are too few sightings for a lens, or no mirror explains any two of them.
    """
    camera, seen = lens_and_places(boards, sightings, size)
    planes = find_planes(camera, seen)
    read = []
    for photo in sorted({s.sighting.photo for s in seen}):
        read += read_photo(boards, camera, planes, [s for s in seen if s.sighting.photo == photo])
    names = _names(planes, read)
    chains = sorted({chain for chain, _ in read}, key=lambda c: (len(c), c))
    mirrors = {
        names[i]: Mirror.from_plane(names[i], T_RIG_CAM[:3, :3] @ p.normal, p.offset)
        for i, p in enumerate(planes)
        if any(i in chain for chain in chains)
    }
    views, named = {}, []
    for chain in chains:
        name = "-".join(names[i] for i in chain) or "direct"
        own = [s for c, s in read if c == chain]
        views[name] = View(tuple(names[i] for i in chain), _hull(own) if chain else None)
        named += [replace(s, view=name) for s in own]
    return Rig(camera, T_RIG_CAM, mirrors, views), sorted(named, key=lambda s: s.photo)


def _names(planes: Sequence[Plane], read: Sequence[tuple[tuple[int, ...], Sighting]]) -> list[str]:
    """`mirror`, or `left` and `right`, or `mirror1` ... from left to right on the photo."""
    middle = [
        np.mean(
            np.concatenate([s.pixels for c, s in read if c and c[0] == i] or [np.full((1, 2), np.inf)])[:, 0]
        )
        for i in range(len(planes))
    ]
    words = {1: ["mirror"], 2: ["left", "right"]}.get(
        len(planes), [f"mirror{i + 1}" for i in range(len(planes))]
    )
    names = [""] * len(planes)
    for word, i in zip(words, np.argsort(middle, kind="stable")):
        names[int(i)] = word
    return names


def _hull(sightings: Sequence[Sighting]) -> Array:
    pixels = np.concatenate([s.pixels for s in sightings]).astype(np.float32)
    return np.asarray(cv2.convexHull(pixels)[:, 0], dtype=np.float64)
