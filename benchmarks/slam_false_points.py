"""Map points that exist nowhere, by how often tracking has found them since they were made.

Corners that look alike meet at a depth and fit the pose at which they did. A point counts as false if the
rays to it, drawn from the true poses of its keyframes, miss their meeting by more than 5 px in one of them.
Every point is counted once for each number of times that it has been found. Films are those of
`slam_rigs.py`, by sight alone.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from itertools import chain
from pathlib import Path

import numpy as np
from _common import data_folder, show
from _rig_films import ELSEWHERE, FILMS, render
from numpy.typing import NDArray
from slam_starts import Case, play

from facetcam.io.trajectories import read_tum
from facetcam.slam import Slam, State
from facetcam.slam.adjustment.bundle import Bundle
from facetcam.slam.camera.optics import Optics

Array = NDArray[np.float64]

OFF = 5.0  # px
GROUPS = ((0, 0), (1, 1), (2, 2), (3, 7), (8, 1 << 30))
COLUMNS = ("film", "points", "found never", "once", "twice", "3 to 7 times", "more often")


class Census:
    """Looks at the whole map after each keyframe."""

    def __init__(self, truth: Path) -> None:
        self._times, self._poses = read_tum(truth)
        self._known: set[tuple[int, int, int]] = set()
        self.rows: list[tuple[int, bool]] = []  # times found, and whether it is false

    def look(self, slam: Slam, state: State) -> None:
        if state.keyframe and (bundle := slam._parts.adjuster.whole()) is not None:
            self.rows += self._new(slam, bundle)

    def _new(self, slam: Slam, bundle: Bundle) -> Iterator[tuple[int, bool]]:
        map = slam._map
        at = [int(np.argmin(np.abs(self._times - k.timestamp))) for k in map.keyframes]
        miss = misses(bundle, self._poses[at], slam._parts.optics)
        ids = np.unique(map.observed_points(map.keyframes))
        for point, found, off in zip(ids.tolist(), map.points.found[ids].tolist(), miss.tolist()):
            if (key := (map.number, point, found)) not in self._known and not np.isnan(off):
                self._known.add(key)
                yield found, off > OFF


def misses(bundle: Bundle, T_world_rig: Array, optics: Optics) -> Array:
    """By how many pixels (P,) each point misses at least one of its sightings from poses (K, 4, 4).

    It stands where the rays to it come nearest to each other; nan where these are parallel.
    """
    T, P = T_world_rig[bundle.frame], len(bundle.points)
    origins = np.einsum("nij,nj->ni", T[:, :3, :3], optics.origins(bundle.view)) + T[:, :3, 3]
    rays = np.einsum("nij,nj->ni", T[:, :3, :3], optics.plane_rays(bundle.plane, bundle.view))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    across = np.eye(3) - rays[:, :, None] * rays[:, None, :]
    A, b = np.zeros((P, 3, 3)), np.zeros((P, 3))
    np.add.at(A, bundle.point, across)
    np.add.at(b, bundle.point, np.einsum("nij,nj->ni", across, origins))
    meet = np.linalg.eigvalsh(A)[:, 0] > 1e-9
    xyz = np.full((P, 3), np.nan)
    xyz[meet] = np.linalg.solve(A[meet], b[meet][:, :, None])[:, :, 0]
    from_rig = np.einsum("nji,nj->ni", T[:, :3, :3], xyz[bundle.point] - T[:, :3, 3])
    plane, depth = optics.to_plane(from_rig, bundle.view)
    off = np.where(depth > 0, np.linalg.norm(plane - bundle.plane, axis=1), np.inf)
    out = np.zeros(P)
    np.maximum.at(out, bundle.point, off)
    return out


def count(case: Case) -> list[tuple[int, bool]]:
    census = Census(case.folder / "truth.tum")
    play(case, census.look)
    return census.rows


def row(name: str, counted: list[tuple[int, bool]]) -> list[str]:
    found, false = np.array(counted, dtype=int).reshape(-1, 2).T
    groups = [(found >= least) & (found <= most) for least, most in GROUPS]
    return [name, str(len(found)), *(f"{100 * np.mean(false[g]):.2f} %" if g.any() else "" for g in groups)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cache", type=Path, default=Path("rig_films"), help="folder of films")
    parser.add_argument("--only", default="", help="only films whose name holds this")
    options = parser.parse_args()
    scene = data_folder() / "house" / "small_house.glb"
    films = [film for film in [*FILMS, *ELSEWHERE] if options.only in film.name]
    cases = [Case(film.name, render(film, scene, options.cache), 0, False) for film in films]
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        counted = list(pool.map(count, cases))
    rows = [row(case.name, c) for case, c in zip(cases, counted)]
    show(
        "false points, by how often they were found",
        COLUMNS,
        [*rows, row("all", [*chain.from_iterable(counted)])],
    )


if __name__ == "__main__":
    main()
