"""Follow camera rays from mirror to mirror."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from facetcam.rig.mirrors import Mirror

Array = NDArray[np.float64]

NO_MIRROR = -1


@dataclass(frozen=True)
class Bounce:
    """First mirrors that rays meet.

    Attributes
    ----------
    mirror : (N,) int8 array
        Index of the nearest mirror, NO_MIRROR where a ray leaves freely.
    distance : (N,) array
        Metres to it, inf where there is none.
    """

    mirror: NDArray[np.int8]
    distance: Array


def first_mirror(mirrors: Sequence[Mirror], origins: Array, directions: Array) -> Bounce:
    """Find the nearest mirror in front of rays (N, 3), (N, 3)."""
    nearest = np.full(len(directions), np.inf)
    index = np.full(len(directions), NO_MIRROR, dtype=np.int8)
    for i, mirror in enumerate(mirrors):
        distance = mirror.distance(origins, directions)
        closer = distance < nearest
        nearest[closer] = distance[closer]
        index[closer] = i
    return Bounce(index, nearest)


def reflect(mirror: Mirror, origins: Array, directions: Array, distance: Array) -> tuple[Array, Array]:
    """Points where rays meet a mirror, and the directions in which they go on."""
    points = origins + distance[:, None] * directions
    return points, directions - 2.0 * (directions @ mirror.normal)[:, None] * mirror.normal


def follow_chain(
    mirrors: Sequence[Mirror], chain: Sequence[int], origins: Array, directions: Array
) -> tuple[NDArray[np.bool_], Array, Array, Bounce]:
    """Send rays through one chain of mirrors.

    Returns
    -------
    reached : (N,) bool array
        True where the ray meets exactly the mirrors of the chain, in order.
    origins, directions : (N, 3) arrays
        The rays after the last mirror (of all rays, also of those that missed).
    onward : Bounce
        What the rays meet after the chain; an obstacle for anything that lies beyond it.
    """
    reached = np.ones(len(directions), dtype=bool)
    for index in chain:
        bounce = first_mirror(mirrors, origins, directions)
        reached &= bounce.mirror == index
        distance = np.where(reached, bounce.distance, 0.0)
        origins, directions = reflect(mirrors[index], origins, directions, distance)
    return reached, origins, directions, first_mirror(mirrors, origins, directions)
