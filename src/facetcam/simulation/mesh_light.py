"""Where light is known on a triangle mesh, and what every lamp sends there, baked once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from facetcam.simulation.light import SCATTERED, Tracer, direct, openness
from facetcam.simulation.meshes import Mesh
from facetcam.simulation.scene import Lamp

Array = NDArray[np.float64]
Array32 = NDArray[np.float32]
Progress = Callable[[int, int | None], None]

SPACING = 0.12  # metres between places on large triangles
MOST_PLACES = 1_000_000  # on large triangles; a larger scene gets wider spaces
MOST_STEPS = 2000
_INSET = 0.01  # metres by which places stay away from the triangle's edges, where neighbours touch
_LIFT = 2e-3  # metres; rays start off their own surface
_AT_ONCE = 50_000
_SHADOW_RAYS, _CORNER_RAYS = (
    4,
    10,
)  # thirty places a square metre and side need fewer than a close view of one


@dataclass(frozen=True, eq=False)
class Lattices:
    """Places of light: the corners first, then a lattice for each large triangle.

    Attributes
    ----------
    first, steps : (T,) int32 arrays
        Of each triangle; one step stands for its three corners.
    place, normal : (P, 3) arrays
    """

    first: NDArray[np.int32]
    steps: NDArray[np.int32]
    place: Array
    normal: Array


def lattices(mesh: Mesh) -> Lattices:
    """Spread places of light over a mesh, closer than SPACING where memory allows."""
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    spacing = SPACING
    while True:
        steps = np.clip(np.ceil(longest / spacing), 1, MOST_STEPS).astype(np.int64)
        sizes = np.where(steps > 1, (steps + 1) * (steps + 2) // 2, 0)
        if sizes.sum() <= MOST_PLACES:
            break
        spacing *= 1.3
    first = len(mesh.vertices) + np.concatenate([[0], np.cumsum(sizes)[:-1]])
    total = len(mesh.vertices) + int(sizes.sum())
    place, normal = np.zeros((total, 3)), np.zeros((total, 3))
    place[mesh.faces] = _inset(corners)
    normal[: len(mesh.vertices)] = mesh.normals
    for count in np.unique(steps[steps > 1]):
        chosen = np.flatnonzero(steps == count)
        shares = _shares(int(count))
        index = first[chosen, None] + np.arange(len(shares))
        place[index] = np.einsum("ks,tsc->tkc", shares, _inset(corners[chosen]))
        turned = np.einsum("ks,tsc->tkc", shares, mesh.normals[mesh.faces[chosen]].astype(np.float64))
        normal[index] = turned / np.maximum(np.linalg.norm(turned, axis=2, keepdims=True), 1e-9)
    normal[np.linalg.norm(normal, axis=1) < 0.5] = (0.0, 0.0, 1.0)  # of corners that no triangle has
    return Lattices(first.astype(np.int32), steps.astype(np.int32), place, normal)


def _shares(steps: int) -> Array:
    """Shares (K, 3) of the three corners at the places of a lattice, row by row along the first edge."""
    j, i = np.divmod(np.arange((steps + 1) ** 2), steps + 1)
    i, j = i[i + j <= steps] / steps, j[i + j <= steps] / steps
    return np.column_stack([1.0 - i - j, i, j])


def _inset(corners: Array) -> Array:
    """Corners (T, 3, 3) moved a little towards the middles of their triangles."""
    away = corners.mean(axis=1, keepdims=True) - corners
    length = np.maximum(np.linalg.norm(away, axis=2, keepdims=True), 1e-9)
    return np.asarray(corners + away * np.minimum(_INSET / length, 0.1))


@dataclass(eq=False)
class MeshLight:
    """Irradiance of each lamp at full power on both sides of each place, and of the light from everywhere.

    Attributes
    ----------
    irradiance : (L, P, 2) float32 array
    open_share : (P, 2) float32 array
        1 in an open place, less in corners.
    """

    lamps: tuple[Lamp, ...]
    irradiance: Array32
    open_share: Array32
    ambient: tuple[float, float, float]
    _last: tuple[tuple[float, ...], Array32] | None = None

    def at(self, time: float) -> Array32:
        """Irradiance (P, 2, 3) in red, green and blue at a time in seconds."""
        levels = tuple(lamp.level(time) for lamp in self.lamps)
        if self._last is None or self._last[0] != levels:  # lamps rarely change from frame to frame
            self._last = levels, self._mixed(levels)
        return self._last[1]

    def _mixed(self, levels: tuple[float, ...]) -> Array32:
        light = self.open_share[..., None] * np.array(self.ambient, dtype=np.float32)
        for lamp, level, share in zip(self.lamps, levels, self.irradiance):
            if level > 0.0:
                light += share[..., None] * np.multiply(lamp.colour, level).astype(np.float32)
        return np.asarray(light, dtype=np.float32)


def bake_mesh(
    points: Lattices,
    lamps: tuple[Lamp, ...],
    ambient: tuple[float, float, float],
    trace: Tracer,
    progress: Progress,
) -> MeshLight:
    """Compute what each lamp sends to each place, on both sides, with the scene's own rays."""
    count = len(points.place)
    irradiance = np.zeros((len(lamps), count, 2), dtype=np.float32)
    open_share = np.ones((count, 2), dtype=np.float32)
    if not lamps and not any(ambient):
        return MeshLight(lamps, irradiance, open_share, ambient)
    for start in range(0, count, _AT_ONCE):
        some = slice(start, start + _AT_ONCE)
        for side, sign in enumerate((1.0, -1.0)):
            normal = sign * points.normal[some]
            place = points.place[some] + _LIFT * normal
            share = openness(place, normal, trace, _CORNER_RAYS)
            open_share[some, side] = share
            for k, lamp in enumerate(lamps):
                light = direct(lamp, place, normal, trace, _SHADOW_RAYS) + SCATTERED * lamp.power * share
                irradiance[k, some, side] = light
        progress(min(start + _AT_ONCE, count), count)
    return MeshLight(lamps, irradiance, open_share, ambient)
