"""Where a board stands among mirrors, so that chains of them explain what a photo shows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import permutations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from facetcam.calibration.boards import Board, BoardSet
from facetcam.calibration.bootstrap_lens import Seen
from facetcam.calibration.bootstrap_planes import NEAR, Plane
from facetcam.calibration.sightings import Sighting
from facetcam.geometry import reflection, se3
from facetcam.rig import Camera

Array = NDArray[np.float64]


def read_photo(
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
    best: tuple[float, list[tuple[tuple[int, ...], Sighting]]] = (NEAR * seen.square_px, [])
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
    return [part for chain, way in best[1] for part in _cut(board, camera, planes, chain, way)]


def _cut(
    board: Board, camera: Camera, planes: Sequence[Plane], chain: tuple[int, ...], way: Sighting
) -> list[tuple[tuple[int, ...], Sighting]]:
    """Of two mirrors the nearer on a corner's ray comes first in its chain."""
    if len(chain) < 2:
        return [(chain, way)]
    rays = camera.ray(way.pixels)
    distance = np.stack([planes[i].offset / np.maximum(rays @ planes[i].normal, 1e-9) for i in chain])
    first = distance[0] <= distance[1]
    parts = ((chain, first), (chain[::-1], ~first))
    some = [(c, replace(way, corners=way.corners[m], pixels=way.pixels[m])) for c, m in parts]
    return [(c, part) for c, part in some if _spans_a_plane(board.points[part.corners])]


def _spans_a_plane(points: Array) -> bool:
    """Tell whether there are four corners at least, and not all in one row, which places no board."""
    return len(points) >= 4 and int(np.linalg.matrix_rank(points - points.mean(axis=0), tol=1e-9)) == 2


def _chains(count: int) -> list[tuple[int, ...]]:
    return [(), *((i,) for i in range(count)), *permutations(range(count), 2)]
