"""What a lamp sends to places, direct with soft shadows and scattered."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from facetcam.simulation.scene import Lamp

Array = NDArray[np.float64]

LAMP_RADIUS = 0.10
SCATTERED = 0.16  # scattered light in an open place, as a share of the lamp's power
REACH = 0.9  # metres from which surroundings no longer darken a corner

# (origins (N, 3), directions (N, 3)) -> hits with a field "distance"
Tracer = Callable[[Array, Array], NDArray[np.void]]


def _sphere(count: int) -> Array:
    """Evenly spread unit vectors (count, 3): a Fibonacci spiral."""
    z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    angle = np.pi * (1.0 + 5.0**0.5) * np.arange(count)
    return np.column_stack([np.cos(angle) * np.sqrt(1 - z * z), np.sin(angle) * np.sqrt(1 - z * z), z])


def direct(lamp: Lamp, place: Array, normal: Array, trace: Tracer, rays: int) -> Array:
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


def openness(place: Array, normal: Array, trace: Tracer, rays: int) -> Array:
    """Ambient obscurance: 1 where the surroundings are further than REACH, less in corners."""
    total = np.zeros(len(place))
    for direction in _sphere(rays):
        bent = normal * 1.001 + direction  # cosine-weighted about the normal
        bent /= np.linalg.norm(bent, axis=1, keepdims=True)
        total += np.minimum(trace(place, bent)["distance"] / REACH, 1.0)
    return total / rays
