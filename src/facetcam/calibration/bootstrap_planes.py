"""Mirrors in photos without a drawing: planes that reflect sightings of a board onto each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from facetcam.calibration.bootstrap_lens import Seen
from facetcam.errors import FacetcamError
from facetcam.geometry import reflection, se3
from facetcam.rig import Camera

Array = NDArray[np.float64]

NEAR = 0.35  # squares within which a prediction explains a sighting
_SAME_TURN = np.radians(4.0)  # between two findings of one mirror
_SAME_SHIFT = 0.06  # of the distance, the same
_COMMON = 6  # corners that two sightings must share


@dataclass(frozen=True, eq=False)
class Plane:
    """normal . x = offset in the camera frame, the offset positive."""

    normal: Array
    offset: float

    def is_before(self, points: Array) -> bool:
        """Whether points (N, 3) all lie on the camera's side."""
        return bool((points @ self.normal < self.offset).all())

    @property
    def S(self) -> Array:
        """The reflection (4, 4)."""
        return reflection.reflection(self.normal, self.offset)


def find_planes(camera: Camera, seen: Sequence[Seen]) -> list[Plane]:
    """Mirrors: planes that reflect sightings onto others, those on which most photos agree first."""
    found: list[tuple[Seen, Plane]] = []
    for a, b in permutations([s for s in seen if s.placed], 2):
        one, other = a.sighting, b.sighting
        if (one.photo, one.board) == (other.photo, other.board):
            plane = _plane_between(camera, a, b)
            if plane is not None:
                found.append((a, plane))
    least = 2 if len({s.sighting.photo for s in seen}) > 2 else 1
    accepted: list[Plane] = []
    while found:
        groups = [[(a, p) for a, p in found if _same(p, plane)] for _, plane in found]
        photos = [len({a.sighting.photo for a, _ in group}) for group in groups]
        best = max(range(len(found)), key=lambda i: (photos[i], len(groups[i]), -found[i][1].offset))
        if photos[best] < least:
            break
        normal = np.median([p.normal for _, p in groups[best]], axis=0)
        offset = float(np.median([p.offset for _, p in groups[best]]))
        mirror = Plane(normal / np.linalg.norm(normal), offset)
        accepted.append(mirror)
        # What reflects something that is itself behind this mirror is an image of a mirror, not a mirror.
        found = [(a, p) for a, p in found if not _same(p, found[best][1]) and mirror.is_before(a.points)]
    if not accepted:
        raise FacetcamError(
            "calibration: no plane mirror explains two sightings of a board in one photo;"
            " photos without a rig file must show a board directly and in each mirror at once"
        )
    return accepted


def _plane_between(camera: Camera, a: Seen, b: Seen) -> Plane | None:
    """The plane that reflects sighting a onto b, if there is one; the camera and a on the same side of it."""
    for way in b.ways[True] if a.ways[False] else []:
        _, i, j = np.intersect1d(a.ways[False][0].corners, way.corners, return_indices=True)
        if len(i) < _COMMON:
            continue
        across = (b.points[j] - a.points[i]).mean(axis=0)
        normal = across / max(float(np.linalg.norm(across)), 1e-12)
        offset = float(normal @ (a.points[i] + b.points[j]).mean(axis=0) / 2)
        plane = Plane(normal, offset)
        pixels, valid = camera.project(se3.transform(plane.S, a.points[i]))
        off = np.linalg.norm(pixels - b.sighting.pixels[j], axis=1)
        if offset > 0 and valid.all() and np.median(off) < NEAR * b.square_px and _turned(plane, a, b, i, j):
            return plane
    return None


def _turned(plane: Plane, a: Seen, b: Seen, i: NDArray[np.int64], j: NDArray[np.int64]) -> bool:
    """Whether the reflection also turns the board as seen: a far board fits many planes by its middle."""
    spread_a, spread_b = a.points[i] - a.points[i].mean(axis=0), b.points[j] - b.points[j].mean(axis=0)
    turned = spread_a @ plane.S[:3, :3].T
    return bool(np.linalg.norm(turned - spread_b) < 0.25 * np.linalg.norm(spread_b))


def _same(a: Plane, b: Plane) -> bool:
    turn = np.arccos(np.clip(a.normal @ b.normal, -1, 1))
    return bool(turn < _SAME_TURN and abs(a.offset - b.offset) < _SAME_SHIFT * max(a.offset, b.offset))
