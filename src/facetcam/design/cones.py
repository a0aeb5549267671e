"""Areas on the sphere of directions, as disjoint convex cones with their tip in the camera.

Flat mirrors have straight edges, and unfolding keeps them straight, so whatever a camera sees through mirrors
is bounded by planes through its centre: cutting cones is exact, and takes microseconds where tracing every
pixel takes a second.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NOTHING: Array = np.empty((0, 3))

_TOUCH = 1e-12  # a corner this near to a plane lies on it
_SLIVER = 1e-13  # steradians of a piece that rounding left over
_SAME = 1e-8  # distance of two corners on the unit sphere that are one


def clip(corners: Array, half_space: Array) -> Array:
    """Cut a convex polygon to one side of a plane.

    Parameters
    ----------
    corners : (N, 3) or (N, 4) array
        Directions in order round a cone, or homogeneous points (x, y, z, 1) round a polygon.
    half_space : (3,) or (4,) array
        What lies where the product with it is not negative is kept.
    """
    side = corners @ half_space
    if side.min(initial=0.0) >= -_TOUCH:
        return corners
    if side.max(initial=0.0) <= _TOUCH:
        return corners[:0]
    kept = []
    before, before_side = corners[-1], side[-1]
    for corner, own_side in zip(corners, side):
        if (own_side > 0) != (before_side > 0):
            share = before_side / (before_side - own_side)
            kept.append(before + share * (corner - before))
        if own_side > 0:
            kept.append(corner)
        before, before_side = corner, own_side
    return np.array(kept) if len(kept) >= 3 else corners[:0]


def walls(cone: Array) -> Array:
    """Normals (N, 3) of the planes through the tip that bound a convex cone; inside, products are >= 0."""
    following = np.concatenate([cone[1:], cone[:1]])
    normals = cross(cone, following)
    lengths = np.sqrt(np.einsum("ij,ij->i", normals, normals))
    normals = normals[lengths > _TOUCH] / lengths[lengths > _TOUCH, None]
    turned: Array = normals if (normals @ cone.sum(axis=0)).sum() >= 0 else -normals
    return turned


def intersect(cone: Array, half_spaces: Iterable[Array]) -> Array:
    """The part of a convex cone that lies inside all planes; empty (0, 3) where there is none."""
    for half_space in half_spaces:
        cone = clip(cone, half_space)
        if not len(cone):
            return NOTHING
    return cone


def subtract(cone: Array, half_spaces: Iterable[Array]) -> list[Array]:
    """What is left of a convex cone without another, given by its walls, as disjoint convex cones."""
    left, rest = [], cone
    for half_space in half_spaces:
        outside = clip(rest, -half_space)
        rest = clip(rest, half_space)
        if not len(rest):
            return [cone]  # they do not meet: no need to cut it up
        if len(outside) and solid_angle(outside) > _SLIVER:
            left.append(outside)
    return left


def subtract_all(cones: Sequence[Array], others: Iterable[Array]) -> list[Array]:
    """Cones without any of the others, each given by its walls."""
    left = list(cones)
    for half_spaces in others:
        left = [piece for cone in left for piece in subtract(cone, half_spaces)]
    return left


def solid_angle(cone: Array) -> float:
    """Steradians of a convex cone: triangles of a fan, each by Van Oosterom and Strackee (1983)."""
    corners = _unit(cone)
    a, b, c = corners[0], corners[1:-1], corners[2:]
    triple = cross(b, c) @ a
    below = 1.0 + b @ a + c @ a + np.einsum("ij,ij->i", b, c)
    return float(abs(2.0 * np.arctan2(triple, below).sum()))


def contains(cones: Iterable[Array], directions: Array) -> NDArray[np.bool_]:
    """Tell which unit directions (N, 3) lie in any of the convex cones."""
    inside = np.zeros(len(directions), dtype=bool)
    for cone in cones:
        corners = _unit(cone)
        axis = _unit(corners.sum(axis=0))
        # A round cone about all corners holds all between them, unless it is wider than a half space.
        widest = (corners @ axis).min()
        near = np.flatnonzero(directions @ axis >= widest - _SAME) if widest > 0.0 else slice(None)
        inside[near] |= (directions[near] @ walls(cone).T >= 0).all(axis=1)
    return inside


def outlines(cones: Sequence[Array]) -> list[Array]:
    """Closed outlines, unit directions (N, 3) each, of an area that was cut into disjoint convex cones.

    Edges that two pieces share cancel; what remains is chained. An area with a hole has two outlines.
    """
    rings = [_turned(_unit(cone)) for cone in cones]
    if not rings:
        return []
    corners = _distinct(np.vstack(rings))
    edges: set[tuple[int, int]] = set()
    for ring in rings:
        ids = [int(np.argmin(((corners - corner) ** 2).sum(axis=1))) for corner in ring]
        for start, end in zip(ids, ids[1:] + ids[:1]):
            for a, b in _split(corners, start, end):
                if (b, a) in edges:
                    edges.remove((b, a))
                elif a != b:
                    edges.add((a, b))
    rims = [_without_straight(corners[loop]) for loop in _loops(edges)]
    return [rim for rim in rims if len(rim) >= 3]


def densify(outline: Array, step: float = math.radians(0.5)) -> Array:
    """Points (M, 3) along an outline, at most `step` radians apart, the first again at the end."""
    following = np.concatenate([outline[1:], outline[:1]])
    angle = np.arctan2(np.linalg.norm(cross(outline, following), axis=1), (outline * following).sum(axis=1))
    counts = np.maximum(1, np.ceil(angle / step)).astype(int)
    within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    shares = (within / np.repeat(counts, counts))[:, None]
    points = np.repeat(outline, counts, axis=0) + shares * np.repeat(following - outline, counts, axis=0)
    return _unit(np.vstack([points, outline[:1]]))


def cross(a: Array, b: Array) -> Array:
    """Products of rows (N, 3); NumPy's own takes longer over its axes than over few rows."""
    after, last = [1, 2, 0], [2, 0, 1]
    product: Array = a[..., after] * b[..., last] - a[..., last] * b[..., after]
    return product


def _unit(vectors: Array) -> Array:
    scaled: Array = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return scaled


def _turned(ring: Array) -> Array:
    """A ring with its corners counter-clockwise seen from the tip's far side."""
    following = np.concatenate([ring[1:], ring[:1]])
    return ring if cross(ring, following).sum(axis=0) @ ring.sum(axis=0) >= 0 else ring[::-1]


def _distinct(corners: Array) -> Array:
    kept: list[Array] = []
    for corner in corners:
        if not kept or ((np.array(kept) - corner) ** 2).sum(axis=1).min() > _SAME**2:
            kept.append(corner)
    return np.array(kept)


def _split(corners: Array, start: int, end: int) -> list[tuple[int, int]]:
    """The edge from corner `start` to `end`, cut where other corners lie on it."""
    a, b = corners[start], corners[end]
    normal = cross(a, b)
    length = float(np.linalg.norm(normal))
    if length < _SAME:
        return [(start, end)]
    along = cross(normal / length, a)
    angle = np.arctan2(corners @ along, corners @ a)
    on = (np.abs(corners @ normal) / length < _SAME) & (angle > _SAME)
    on &= angle < math.atan2(length, float(a @ b)) - _SAME
    middle = np.flatnonzero(on)
    ids = [start, *(int(i) for i in middle[np.argsort(angle[middle])] if i not in (start, end)), end]
    return list(pairwise(ids))


def _without_straight(rim: Array) -> Array:
    """An outline without the corners at which it goes straight on."""
    before, after = np.roll(rim, 1, axis=0), np.roll(rim, -1, axis=0)
    normals = cross(before, after)
    off = np.abs(np.einsum("ij,ij->i", normals, rim)) / np.maximum(np.linalg.norm(normals, axis=1), _TOUCH)
    bent: Array = rim[off > _SAME]
    return bent


def _loops(edges: set[tuple[int, int]]) -> list[list[int]]:
    following: dict[int, list[int]] = {}
    for a, b in sorted(edges):
        following.setdefault(a, []).append(b)
    loops = []
    while following:
        start = next(iter(following))
        loop, at = [start], start
        while at in following:
            ahead = following[at].pop()
            if not following[at]:
                del following[at]
            if ahead == start:
                break
            loop.append(ahead)
            at = ahead
        loops.append(loop)
    return loops
