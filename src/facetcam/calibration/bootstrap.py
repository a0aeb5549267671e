"""A rig from photos alone: one camera, plane mirrors, plain boards seen directly and in them.

Where a board seems to be behind a mirror does not depend on how its corners are named, so the lens and the
place of every sighting come first (Zhang's calibration, each sighting by itself). A mirror is a plane that
reflects one sighting of a photo onto another, in several photos. Then each photo is read: where does the
board stand, before all mirrors, so that chains of mirrors explain most of its sightings; this also settles
the order of the corners.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from facetcam.calibration.boards import Board, BoardSet
from facetcam.calibration.chessboards import placements
from facetcam.calibration.sightings import Sighting
from facetcam.errors import FacetcamError
from facetcam.geometry import reflection, se3
from facetcam.rig import Camera, Mirror, Rig, View
from facetcam.rig.camera import BROWN_CONRADY

Array = NDArray[np.float64]

LEAST_CORNERS = 12  # of a sighting that takes part in the first lens
_NEAR = 0.35  # squares within which a prediction explains a sighting
_SAME_TURN = np.radians(4.0)  # between two findings of one mirror
_SAME_SHIFT = 0.06  # of the distance, the same
_SYMMETRIES = 4  # of a board at most
_COMMON = 6  # corners that two sightings must share

T_RIG_CAM = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])


@dataclass(frozen=True, eq=False)
class Seen:
    """A sighting, where its corners seem to be in the camera frame, and its readings behind even and odd
    chains."""

    sighting: Sighting
    points: Array
    square_px: float
    ways: tuple[list[Sighting], list[Sighting]]

    @property
    def placed(self) -> bool:
        """False for a part of a board that may lie in many places on it."""
        return max(map(len, self.ways)) <= _SYMMETRIES


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
    planes = find_planes(boards, camera, seen)
    read = []
    for photo in sorted({s.sighting.photo for s in seen}):
        read += _read(boards, camera, planes, [s for s in seen if s.sighting.photo == photo])
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


def lens_and_places(
    boards: BoardSet, sightings: Sequence[Sighting], size: tuple[int, int]
) -> tuple[Camera, list[Seen]]:
    """The lens by Zhang's calibration, and the corners of every sighting in the camera frame."""
    whole = [s for s in sightings if len(s) >= LEAST_CORNERS]
    if len(whole) < 3:
        raise FacetcamError(
            f"calibration: {len(whole)} sightings with {LEAST_CORNERS} corners or more in all photos;"
            " the lens takes at least 3 with the board at different tilts"
        )
    flat = [boards.boards[s.board].points[s.corners].astype(np.float32) for s in whole]
    pixels = [s.pixels.astype(np.float32).reshape(-1, 1, 2) for s in whole]
    flags = cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_ASPECT_RATIO
    start = np.array(
        [[1.2 * max(size), 0, (size[0] - 1) / 2], [0, 1.2 * max(size), (size[1] - 1) / 2], [0, 0, 1]]
    )
    if len(whole) < 8:
        flags |= cv2.CALIB_FIX_PRINCIPAL_POINT | cv2.CALIB_FIX_K2
    _, K, d, _, _ = cv2.calibrateCamera(
        flat, pixels, size, start, np.zeros(5), flags=flags | cv2.CALIB_USE_INTRINSIC_GUESS
    )
    fx, fy, cx, cy = (float(v) for v in (K[0, 0], K[1, 1], K[0, 2], K[1, 2]))
    if not (0.2 * max(size) < fx < 20 * max(size)):
        raise FacetcamError(
            f"calibration: the sightings give a focal length of {fx:.0f} px, which cannot be; tilt the board"
            " more from photo to photo, and check its squares in boards.yaml"
        )
    camera = Camera(BROWN_CONRADY, *size, fx, fy, cx, cy, tuple(float(v) for v in d.ravel()[:5]))
    return camera, [_placed(camera, boards.boards[s.board], s) for s in whole]


def _placed(camera: Camera, board: Board, sighting: Sighting) -> Seen:
    rays = camera.ray(sighting.pixels)
    flat = board.points[sighting.corners]
    middle = flat.mean(axis=0)
    turns, shifts = cv2.solvePnPGeneric(
        flat - middle, rays[:, :2] / rays[:, 2:], np.eye(3), None, flags=cv2.SOLVEPNP_IPPE
    )[1:3]
    turn, shift = cv2.solvePnPRefineLM(
        flat - middle, rays[:, :2] / rays[:, 2:], np.eye(3), None, turns[0], shifts[0]
    )
    points = (flat - middle) @ cv2.Rodrigues(turn)[0].T + shift.ravel()
    size = (
        np.ptp(sighting.pixels, axis=0) / np.maximum(np.ptp(flat[:, :2], axis=0), board.square) * board.square
    )
    ways = (_ways(sighting, board, False), _ways(sighting, board, True))
    return Seen(sighting, points, float(np.min(size)), ways)


def find_planes(boards: BoardSet, camera: Camera, seen: Sequence[Seen]) -> list[Plane]:
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
        if offset > 0 and valid.all() and np.median(off) < _NEAR * b.square_px and _turned(plane, a, b, i, j):
            return plane
    return None


def _turned(plane: Plane, a: Seen, b: Seen, i: NDArray[np.int64], j: NDArray[np.int64]) -> bool:
    """Whether the reflection also turns the board as seen: a far board fits many planes by its middle."""
    spread_a, spread_b = a.points[i] - a.points[i].mean(axis=0), b.points[j] - b.points[j].mean(axis=0)
    turned = spread_a @ plane.S[:3, :3].T
    return bool(np.linalg.norm(turned - spread_b) < 0.25 * np.linalg.norm(spread_b))


def _ways(sighting: Sighting, board: Board, mirrored: bool) -> list[Sighting]:
    """Readings of a sighting in a view of one parity."""
    if board.kind != "chessboard":
        return [sighting] if sighting.mirrored == mirrored else []
    return placements(sighting, board, mirrored)


def _same(a: Plane, b: Plane) -> bool:
    turn = np.arccos(np.clip(a.normal @ b.normal, -1, 1))
    return bool(turn < _SAME_TURN and abs(a.offset - b.offset) < _SAME_SHIFT * max(a.offset, b.offset))


def _chains(count: int) -> list[tuple[int, ...]]:
    return [(), *((i,) for i in range(count)), *permutations(range(count), 2)]


def _read(
    boards: BoardSet, camera: Camera, planes: Sequence[Plane], seen: Sequence[Seen]
) -> list[tuple[tuple[int, ...], Sighting]]:
    """Chain and corner order of the sightings of one photo, for each board by itself."""
    out = []
    for index in sorted({s.sighting.board for s in seen}):
        own = [s for s in seen if s.sighting.board == index]
        best: tuple[float, list[tuple[tuple[int, ...], Sighting]]] = (0.0, [])
        for T in _standings(boards.boards[index], planes, own):
            explained = [e for s in own for e in _explained(boards.boards[index], camera, planes, T, s)]
            score = sum(len(s) - 0.01 * len(chain) for chain, s in explained)
            if score > best[0]:
                best = (score, explained)
        out += best[1]
    return out


def _standings(board: Board, planes: Sequence[Plane], seen: Sequence[Seen]) -> Iterator[Array]:
    """Places T_cam_board where the board may stand, before all mirrors, by each sighting in each chain."""
    for s in [s for s in seen if s.placed] or seen:
        for chain in _chains(len(planes)):
            S = reflection.chain([planes[i].S for i in chain])
            for way in s.ways[len(chain) % 2]:
                # Unfolded: the image is S_1 ... S_k of the place, and each S its own inverse.
                points = se3.transform(S, s.points)
                if all(p.is_before(points) for p in planes):
                    yield _pose(board.points[way.corners], points)


def _pose(flat: Array, points: Array) -> Array:
    R = Rotation.align_vectors(points - points.mean(axis=0), flat - flat.mean(axis=0))[0].as_matrix()
    return se3.from_rotation_translation(R, points.mean(axis=0) - R @ flat.mean(axis=0))


def _explained(
    board: Board, camera: Camera, planes: Sequence[Plane], T_cam_board: Array, seen: Seen
) -> list[tuple[tuple[int, ...], Sighting]]:
    """Chain and reading that explain a sighting best; in two chains where a seam between mirrors cuts it."""
    best: tuple[float, list[tuple[tuple[int, ...], Sighting]]] = (_NEAR * seen.square_px, [])
    for chain in _chains(len(planes)):
        # A ray meets chain[0] first: its image of what lies behind is outermost.
        T = reflection.chain([planes[i].S for i in reversed(chain)]) @ T_cam_board
        if se3.inverse(T)[2, 3] >= 0:
            continue  # the board turns its back
        pixels, valid = camera.project(se3.transform(T, board.points))
        if not valid.any():
            continue
        for way in seen.ways[len(chain) % 2]:
            off = np.linalg.norm(pixels[way.corners] - way.pixels, axis=1)
            off[~valid[way.corners]] = np.inf
            if np.median(off) < best[0]:
                best = (float(np.median(off)), [(chain, way)])
    return [part for chain, way in best[1] for part in _cut(camera, planes, chain, way)]


def _cut(
    camera: Camera, planes: Sequence[Plane], chain: tuple[int, ...], way: Sighting
) -> list[tuple[tuple[int, ...], Sighting]]:
    """Of two mirrors the nearer on a corner's ray comes first in its chain."""
    if len(chain) < 2:
        return [(chain, way)]
    rays = camera.ray(way.pixels)
    distance = np.stack([planes[i].offset / np.maximum(rays @ planes[i].normal, 1e-9) for i in chain])
    first = distance[0] <= distance[1]
    parts = ((chain, first), (chain[::-1], ~first))
    return [(c, replace(way, corners=way.corners[m], pixels=way.pixels[m])) for c, m in parts if m.sum() >= 4]


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
