"""What each view sees, exactly: the unfolded mirrors, cut by each other, the sensor and the camera's body."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from facetcam.design import cones
from facetcam.design.spec import Body
from facetcam.design.unfolding import Unfolding, beyond
from facetcam.rig import Camera, Rig, View
from facetcam.rig.camera import BROWN_CONRADY

Array = NDArray[np.float64]

_SIDE_STEPS = 12  # straight pieces of each side of the sensor behind a lens with distortion


@dataclass(frozen=True, slots=True)
class Area:
    """What one view sees.

    Attributes
    ----------
    cones : list of (N, 3) arrays
        Disjoint convex cones; corners are directions in the frame of the real camera's raw image.
    R : (3, 3) array
        Turns these directions into the rig frame (of determinant -1 for a mirror image).
    """

    cones: list[Array]
    R: Array

    @property
    def solid_angle(self) -> float:
        """Steradians."""
        return sum(map(cones.solid_angle, self.cones))

    def sees(self, directions: Array) -> NDArray[np.bool_]:
        """Tell which directions (N, 3) of the rig frame are seen, for things far off."""
        return cones.contains(self.cones, directions @ self.R)

    def outlines(self) -> list[Array]:
        """Closed outlines (N, 3), straight between corners, as directions in the camera frame."""
        return cones.outlines(self.cones)


def view_areas(rig: Rig, body: Body | None = None) -> dict[str, Area]:
    """The area of every view; `body` hides what lies behind it."""
    unfolding = Unfolding(rig, body)
    sensor = sensor_cones(rig.camera)
    areas = {name: _area(rig, name, unfolding, sensor) for name in rig.views}
    if any(mirror.polygon is None for mirror in rig.mirrors.values()):
        _give_shared_to_longest(rig, areas)
    return areas


def sensor_cones(camera: Camera) -> list[Array]:
    """The sensor's field of view as convex cones: one for a plain lens, a fan of triangles otherwise."""
    right, bottom = camera.width - 0.5, camera.height - 0.5
    corners = np.array([(-0.5, -0.5), (right, -0.5), (right, bottom), (-0.5, bottom)])
    if camera.model == BROWN_CONRADY and not any(camera.distortion):
        return [camera.ray(corners)]
    shares = np.arange(_SIDE_STEPS)[:, None] / _SIDE_STEPS
    border = np.vstack([a + shares * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0))])
    rays = _innermost_rays(camera, border)
    axis = camera.ray([(camera.cx, camera.cy)])[0]
    return [np.array([axis, a, b]) for a, b in zip(rays, np.roll(rays, -1, axis=0))]


def _area(rig: Rig, name: str, unfolding: Unfolding, sensor: Sequence[Array]) -> Area:
    """Clip by every mirror of the chain and by the sensor; take out whatever stands in the way."""
    view, R = rig.views[name], rig.T_rig_image(name)[:3, :3]
    core = _through_chain(view.mirrors, unfolding)
    if core is None:
        pieces = list(sensor)
    elif not len(core):
        return Area([], R)
    else:
        limits = cones.walls(core)
        pieces = [piece for part in sensor if len(piece := cones.intersect(part, limits))]
    pieces = cones.subtract_all(pieces, _obstacles(rig, view.mirrors, unfolding))
    if view.region is not None:
        parts = [cones.walls(triangle) for triangle in _region_cones(rig.camera, view)]
        cut = [cones.intersect(piece, part) for piece in pieces for part in parts]
        pieces = [piece for piece in cut if len(piece)]
    return Area(pieces, R)


def _through_chain(chain: tuple[str, ...], unfolding: Unfolding) -> Array | None:
    """The cone of rays that meet the mirrors of a chain in order, were nothing else there."""
    cone: Array | None = None
    for bounce, name in enumerate(chain):
        corners = unfolding.through(chain[:bounce])[0][name]
        if bounce:
            previous = unfolding.through(chain[: bounce - 1])[0][chain[bounce - 1]]
            corners = cones.clip(corners, beyond(previous))
        if len(corners) < 3:
            return cones.NOTHING
        rays = corners[:, :3] / np.linalg.norm(corners[:, :3], axis=1, keepdims=True)
        cone = rays if cone is None else cones.intersect(cone, cones.walls(rays))
        if not len(cone):
            return cones.NOTHING
    return cone


def _obstacles(rig: Rig, chain: tuple[str, ...], unfolding: Unfolding) -> Iterator[Array]:
    """Walls of the cone of each thing that stands between two mirrors of the chain, or behind the last."""
    for bounce in range(len(chain) + 1):
        mirrors, body = unfolding.through(chain[:bounce])
        planes = []
        if bounce:
            planes.append(beyond(unfolding.through(chain[: bounce - 1])[0][chain[bounce - 1]]))
        if bounce < len(chain):
            planes.append(-beyond(mirrors[chain[bounce]]))
        ends = {chain[i] for i in (bounce - 1, bounce) if 0 <= i < len(chain)}
        # An unbounded mirror is a wall of unknown extent: it hides nothing behind the last mirror.
        others = [
            corners
            for name, corners in mirrors.items()
            if name not in ends and (bounce < len(chain) or rig.mirrors[name].polygon is not None)
        ]
        for corners in (*others, *body):
            for plane in planes:
                corners = cones.clip(corners, plane)
            if len(corners) >= 3:
                half_spaces = cones.walls(corners[:, :3])
                if len(half_spaces) >= 3:
                    yield half_spaces


def _innermost_rays(camera: Camera, border: Array) -> Array:
    """Rays of border pixels; where the lens gives none, of the last pixel towards the middle that has one."""
    centre = np.array([camera.cx, camera.cy])
    low, high = np.zeros((len(border), 1)), np.ones((len(border), 1))
    whole = np.any(camera.ray(border), axis=1)[:, None]
    for _ in range(40):
        middle = (low + high) / 2
        exists = np.any(camera.ray(centre + middle * (border - centre)), axis=1, keepdims=True)
        low, high = np.where(exists, middle, low), np.where(exists, high, middle)
    return camera.ray(centre + np.where(whole, 1.0, low) * (border - centre))


def _region_cones(camera: Camera, view: View) -> list[Array]:
    assert view.region is not None
    region = np.asarray(view.region, dtype=np.float64)
    steps = 1 if camera.model == BROWN_CONRADY and not any(camera.distortion) else _SIDE_STEPS
    shares = np.arange(steps)[:, None] / steps
    dense = np.vstack([a + shares * (b - a) for a, b in zip(region, np.roll(region, -1, axis=0))])
    rays = camera.ray(dense)
    triangles = [rays[list(ids)] for ids in _ears(dense)]
    return [t for t in triangles if np.linalg.norm(t, axis=1).min() > 0 and len(cones.walls(t)) == 3]


def _ears(polygon: Array) -> Iterator[tuple[int, int, int]]:
    """Triangles of a simple polygon (N, 2), by cutting ears."""
    x, y = polygon.T
    ids = list(range(len(polygon)))
    if np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) < 0:
        ids.reverse()
    while len(ids) > 3:
        for k in range(len(ids)):
            a, b, c = ids[k - 1], ids[k], ids[(k + 1) % len(ids)]
            others = [i for i in ids if i not in (a, b, c)]
            if _turn(polygon, a, b, c) >= 0 and not _any_inside(polygon, (a, b, c), others):
                yield a, b, c
                del ids[k]
                break
        else:
            return  # it crosses itself; what was cut so far is all that can be said
    yield ids[0], ids[1], ids[2]


def _turn(points: Array, a: int, b: int, c: int) -> float:
    (ax, ay), (bx, by), (cx, cy) = points[[a, b, c]]
    return float((bx - ax) * (cy - by) - (by - ay) * (cx - bx))


def _any_inside(points: Array, ear: tuple[int, int, int], others: Sequence[int]) -> bool:
    a, b, c = ear
    return any(
        min(_turn(points, a, b, p), _turn(points, b, c, p), _turn(points, c, a, p)) > 0 for p in others
    )


def _give_shared_to_longest(rig: Rig, areas: dict[str, Area]) -> None:
    """Where several chains share a ray (unbounded mirrors without regions) the longest one has it."""
    by_length = sorted(areas, key=lambda name: len(rig.views[name].mirrors), reverse=True)
    for i, name in enumerate(by_length):
        taken = [cones.walls(cone) for other in by_length[:i] for cone in areas[other].cones]
        areas[name] = Area(cones.subtract_all(areas[name].cones, taken), areas[name].R)


def azimuth_elevation(directions: Array) -> tuple[Array, Array]:
    """Azimuth from the front (+y) to the right, and elevation above the rig's x-y plane, in radians."""
    x, y, z = directions.T
    return np.arctan2(x, y), np.arcsin(np.clip(z / np.linalg.norm(directions, axis=1), -1.0, 1.0))


def direction_grid(step: float = math.radians(1.0)) -> tuple[Array, Array]:
    """Directions (N, 3) over the sphere, rows of equal elevation, and the solid angle of each (N,)."""
    rows, columns = round(math.pi / step), round(math.tau / step)
    elevation = (np.arange(rows) + 0.5) * math.pi / rows - math.pi / 2
    azimuth = (np.arange(columns) + 0.5) * math.tau / columns - math.pi
    e, a = (grid.ravel() for grid in np.meshgrid(elevation, azimuth, indexing="ij"))
    directions = np.stack([np.cos(e) * np.sin(a), np.cos(e) * np.cos(a), np.sin(e)], axis=1)
    return directions, np.cos(e) * (math.pi / rows) * (math.tau / columns)
