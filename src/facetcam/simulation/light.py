"""Light maps: what every lamp sends to every place, direct with soft shadows and scattered, baked once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from facetcam.simulation.scene import Lamp, Scene, Surface

Array = NDArray[np.float64]
Array32 = NDArray[np.float32]

SPACING = 0.06  # metres between light texels
LAMP_RADIUS = 0.10
SCATTERED = 0.16  # scattered light in an open place, as a share of the lamp's power
REACH = 0.9  # metres from which surroundings no longer darken a corner
_SHADOW_RAYS = 8
_CORNER_RAYS = 20
_LIFT = 2e-3  # metres; rays start off their own surface


# (origins (N, 3), directions (N, 3)) -> hits with a field "distance"
Tracer = Callable[[Array, Array], NDArray[np.void]]


@dataclass(frozen=True, eq=False)
class LightMaps:
    """Irradiance of each lamp at full power.

    Attributes
    ----------
    layout : (N, 4) int32 array
        Offset, width, height and 1 (level) of each surface's map.
    irradiance : (L, T) float32 array
        One row a lamp, one column a light texel.
    glow : (T,) float32 array
    """

    lamps: tuple[Lamp, ...]
    layout: NDArray[np.int32]
    irradiance: Array32
    glow: Array32

    def at(self, time: float) -> Array32:
        """Irradiance (T, 3) in red, green and blue at a time in seconds."""
        colours = np.array(
            [np.multiply(lamp.colour, lamp.level(time)) for lamp in self.lamps], dtype=np.float32
        )
        light = self.irradiance.T @ colours.reshape(-1, 3)
        return np.ascontiguousarray(light + self.glow[:, None], dtype=np.float32)


def bake(scene: Scene, trace: Tracer) -> LightMaps:
    """Compute the light maps of a scene with its own rays."""
    layout, points, normals, glow, offset = [], [], [], [], 0
    for surface in scene.surfaces:
        columns, rows = (max(2, int(np.ceil(length / SPACING))) for length in surface.size)
        layout.append((offset, columns, rows, 1))
        points.append(_texel_centres(surface, columns, rows))
        normals.append(np.broadcast_to(surface.normal, points[-1].shape))
        glow.append(np.full(columns * rows, surface.glow, dtype=np.float32))
        offset += columns * rows
    place, normal = np.concatenate(points), np.concatenate(normals)
    place = place + _LIFT * normal
    open_share = openness(place, normal, trace)
    irradiance = [
        direct(lamp, place, normal, trace) + SCATTERED * lamp.power * open_share for lamp in scene.lamps
    ]
    return LightMaps(
        scene.lamps,
        np.array(layout, dtype=np.int32),
        np.array(irradiance, dtype=np.float32).reshape(len(scene.lamps), -1),
        np.concatenate(glow),
    )


def _texel_centres(surface: Surface, columns: int, rows: int) -> Array:
    u, v = np.meshgrid((np.arange(columns) + 0.5) / columns, (np.arange(rows) + 0.5) / rows)
    return surface.at(np.column_stack([u.ravel(), v.ravel()]))


def _sphere(count: int) -> Array:
    """Evenly spread unit vectors (count, 3): a Fibonacci spiral."""
    z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    angle = np.pi * (1.0 + 5.0**0.5) * np.arange(count)
    return np.column_stack([np.cos(angle) * np.sqrt(1 - z * z), np.sin(angle) * np.sqrt(1 - z * z), z])


def direct(lamp: Lamp, place: Array, normal: Array, trace: Tracer, rays: int = _SHADOW_RAYS) -> Array:
    """Lambert's law with the share of the lamp's ball that is in sight."""
    total = np.zeros(len(place))
    facing = None if lamp.facing is None else np.asarray(lamp.facing)
    for point in np.asarray(lamp.position) + LAMP_RADIUS * _sphere(rays):
        towards = point - place
        length = np.linalg.norm(towards, axis=1)
        slope = np.einsum("ij,ij->i", towards, normal) / length
        lit = slope > 0
        if not lit.any():
            continue
        lit[lit] = trace(place[lit], towards[lit] / length[lit, None])["distance"] >= length[lit]
        strength = slope / np.square(length)
        if facing is not None:
            strength *= np.maximum(-towards @ facing / length, 0.0)
        total[lit] += strength[lit]
    return lamp.power * total / rays


def openness(place: Array, normal: Array, trace: Tracer, rays: int = _CORNER_RAYS) -> Array:
    """Ambient obscurance: 1 where the surroundings are further than REACH, less in corners."""
    total = np.zeros(len(place))
    for direction in _sphere(rays):
        bent = normal * 1.001 + direction  # cosine-weighted about the normal
        bent /= np.linalg.norm(bent, axis=1, keepdims=True)
        total += np.minimum(trace(place, bent)["distance"] / REACH, 1.0)
    return total / rays
