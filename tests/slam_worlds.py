"""Rigs of small sensors and ideal worlds of points, for tests of tracking and mapping."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from facetcam.geometry import se3
from facetcam.rig import Camera, Rig, presets
from facetcam.slam.adjustment.bundle import Bundle
from facetcam.slam.camera.frame import Corners
from facetcam.slam.camera.optics import Optics
from facetcam.slam.map.map import Keyframe, Map
from facetcam.slam.relative_pose.measured_motion import Measured
from facetcam.slam.relative_pose.pairs import Pairs

Array = NDArray[np.float64]

ROOM = np.array([2.5, 2.0, 1.3])  # half its width, depth and height in metres
UPRIGHT = se3.from_rotation_translation([[1, 0, 0], [0, 0, 1], [0, -1, 0]], np.zeros(3))  # z looks to +y


def small(rig: Rig, width: int) -> Rig:
    """The rig with a sensor of another resolution."""
    c, s = rig.camera, width / rig.camera.width
    size = {"width": width, "height": round(c.height * s), "fx": c.fx * s, "fy": c.fy * s}
    centre = {"cx": (c.cx + 0.5) * s - 0.5, "cy": (c.cy + 0.5) * s - 0.5}
    return replace(rig, camera=replace(c, **size, **centre))


def folded() -> Rig:
    """The paper's rig behind a lens with distortion, 800x600."""
    rig = small(presets.ryu(), 800)
    return replace(rig, camera=replace(rig.camera, distortion=(-0.06, 0.012, 4e-4, -3e-4, 0.0)))


def pyramid() -> Rig:
    """Three mirror images of the room, 800x600."""
    return small(presets.pyramid(3), 800)


def fisheye() -> Rig:
    """One lens of about 200 degrees without mirrors, 600x600."""
    return Rig(
        Camera("kannala-brandt", 600, 600, 160.0, 162.0, 301.0, 297.5, (0.02, -0.005, 0.001, 0.0)), UPRIGHT
    )


def single() -> Rig:
    """One ordinary camera without mirrors, 640x480."""
    return Rig(Camera("brown-conrady", 640, 480, 420.0, 420.0, 319.5, 239.5, (0.0,) * 5), UPRIGHT)


def by_wheels(T_a_b: Array) -> Measured:
    """A motion as wheels measure it: its yaw to a degree, of pitch and roll nothing."""
    return Measured(T_a_b, np.array([0.1, 0.1, 0.02]))


def assert_motion(T: Array | None, truth: Array, degrees: float, direction: float) -> None:
    """Compare the rotation and the direction of a motion, in degrees."""
    assert T is not None
    turn = se3.log(se3.inverse(truth) @ T)[:3]
    assert np.degrees(np.linalg.norm(turn)) < degrees
    a, b = T[:3, 3], truth[:3, 3]
    assert np.degrees(np.arccos(a @ b / np.linalg.norm(a) / np.linalg.norm(b))) < direction


def walls(rng: np.random.Generator, count: int) -> Array:
    """Points (N, 3) on the walls, the floor and the ceiling of a room round the origin."""
    points = rng.uniform(-1.0, 1.0, (count, 3))
    axis = rng.integers(0, 3, count)
    points[np.arange(count), axis] = np.sign(points[np.arange(count), axis])
    return points * ROOM


def in_sight(optics: Optics, T_world_rig: Array, rng: np.random.Generator, count: int) -> Array:
    """Points (N, 3) at 0.8 to 3 m before the views of frames, as many before each frame."""
    rows, columns = np.nonzero(optics.labels >= 0)
    parts = []
    for T in T_world_rig:
        pick = rng.integers(0, len(rows), count // len(T_world_rig))
        pixels = np.column_stack([columns[pick], rows[pick]]).astype(float)
        views = optics.labels[rows[pick], columns[pick]]
        away = rng.uniform(0.8, 3.0, (len(pick), 1)) * optics.rays(pixels, views)
        parts.append(se3.transform(T, optics.origins(views) + away))
    return np.concatenate(parts)


@dataclass(slots=True)
class Sight:
    """What a rig sees of world points: their rows, and views, raw pixels and pinhole positions."""

    point: NDArray[np.int64]
    view: NDArray[np.int8]
    pixels: Array
    plane: Array


def look(optics: Optics, T_world_rig: Array, points: Array) -> Sight:
    """See points through every view, by the rig's own projection; pixels off the mask do not count."""
    parts = []
    for index, name in enumerate(optics.rig.view_names):
        pixels, visible = optics.rig.project(name, se3.transform(se3.inverse(T_world_rig), points))
        rows = np.flatnonzero(visible & (optics.view_of(pixels) == index))
        parts.append((rows, np.full(len(rows), index, np.int8), pixels[rows]))
    point, view, pixels = (np.concatenate(column) for column in zip(*parts))
    return Sight(point, view, pixels, optics.plane(pixels, view))


def distinct_corners(
    pixels: Array, views: NDArray[np.int8], plane: Array, descriptors: NDArray[np.uint8]
) -> Corners:
    """Corners none of which lies on an edge."""
    return Corners(pixels, views, plane, descriptors, np.zeros(len(pixels), np.bool_))


def bundle_of(optics: Optics, T_world_rig: Array, points: Array, noise: Array | None = None) -> Bundle:
    """Exact observations of points by frames, the first one held; `noise` (M, 2) is added in pixels."""
    sights = [look(optics, T, points) for T in T_world_rig]
    plane = np.concatenate([s.plane for s in sights])
    seen = np.concatenate([s.point for s in sights])
    often = np.flatnonzero(np.bincount(seen, minlength=len(points)) >= 2)
    kept = np.isin(seen, often)
    return Bundle(
        T_world_rig=T_world_rig.copy(),
        fixed=np.arange(len(T_world_rig)) == 0,
        points=points[often],
        frame=np.repeat(np.arange(len(sights)), [len(s.point) for s in sights])[kept],
        view=np.concatenate([s.view for s in sights]).astype(np.int64)[kept],
        point=np.searchsorted(often, seen[kept]),
        plane=(plane if noise is None else plane + noise[: len(plane)])[kept],
    )


def winding_path(count: int, length: float = 1.0) -> Array:
    """Poses (N, 4, 4) of a rig that drives a bow and climbs a little, from the origin."""
    along = np.linspace(0.0, 1.0, count)
    twists = [
        (0.03 * np.sin(5 * s), 0.02 * s, 0.5 * s, 0.2 * length * s, length * s, 0.08 * length * s * s)
        for s in along
    ]
    return np.array([se3.exp(twist) for twist in twists])


def true_pairs(optics: Optics, T_a_b: Array, rng: np.random.Generator, count: int = 2500) -> Pairs:
    """What is seen in the same view of two frames."""
    points = in_sight(optics, np.array([np.eye(4), T_a_b]), rng, count)
    a, b = look(optics, np.eye(4), points), look(optics, T_a_b, points)
    _, rows_a, rows_b = np.intersect1d(128 * a.point + a.view, 128 * b.point + b.view, return_indices=True)
    return Pairs(a.view[rows_a], a.plane[rows_a], b.plane[rows_b])


def spoiled(pairs: Pairs, optics: Optics, rng: np.random.Generator, share: float, noise: float) -> Pairs:
    """The same pairs with noise in pixels, a share of them paired with others of their view."""
    plane_b = pairs.plane_b + rng.normal(0.0, noise, pairs.plane_b.shape)
    for view in range(optics.n_views):
        rows = np.flatnonzero((pairs.views == view) & (rng.random(len(pairs)) < share))
        plane_b[rows] = plane_b[np.roll(rows, 1)]
    return Pairs(pairs.views, pairs.plane_a + rng.normal(0.0, noise, plane_b.shape), plane_b)


def mapped(true: Rig, optics: Optics, path: Array, rng: np.random.Generator, noise: float) -> Map:
    """The map of a world that `true` saw along a path, as the rig of `optics` takes what was seen."""
    eyes, world = Optics(true, 8.0), Map()
    points = in_sight(eyes, path, rng, 900)
    sights = [look(eyes, T, points) for T in path]
    often = np.bincount(np.concatenate([s.point for s in sights]), minlength=len(points)) >= 3
    world.points.extend(xyz=points)
    for index, (T, seen) in enumerate(zip(path, sights)):
        rows = np.flatnonzero(often[seen.point])
        pixels = seen.pixels[rows] + rng.normal(0.0, noise, (len(rows), 2))
        keyframe = Keyframe(index, 0.1 * index, T.copy(), Corners.none(), None, None)
        view = seen.view[rows]
        keyframe.observations.append(seen.point[rows], view, pixels, optics.plane(pixels, view))
        world.keyframes.append(keyframe)
    return world
