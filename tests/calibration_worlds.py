"""Rooms of boards round a rig, seeded, for tests and benchmarks of calibration."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from facetcam.calibration import Board, BoardSet, Sighting
from facetcam.calibration.synthetic import projected_sightings
from facetcam.geometry import se3
from facetcam.rig import Camera, Mirror, Rig

Array = NDArray[np.float64]


def boards(count: int, fixed: bool, square: float = 0.06, squares: tuple[int, int] = (11, 8)) -> BoardSet:
    """ChArUco boards with ids of their own."""
    ids = squares[0] * squares[1] // 2
    return BoardSet(
        tuple(
            Board(f"board{b}", "charuco", squares, square, 0.75 * square, "DICT_5X5_1000", ids * b)
            for b in range(count)
        ),
        fixed,
    )


def facing(
    board: Board, origin: Array, direction: Array, distance: float, random: np.random.Generator
) -> Array:
    """Pose of a board that faces an origin, turned by up to 30 degrees and rolled at will."""
    z = direction / np.linalg.norm(direction)
    x = np.cross([0.3, 0.1, 1.0], z)
    x /= np.linalg.norm(x)
    R = np.column_stack([x, np.cross(z, x), z])
    tilt = se3.exp(np.r_[random.uniform(-0.5, 0.5, 2), random.uniform(-np.pi, np.pi), 0, 0, 0])[:3, :3]
    middle = np.array([*board.size, 0.0]) / 2
    R = R @ tilt
    return se3.from_rotation_translation(R, origin + distance * z - R @ middle)


def in_view(rig: Rig, view: str, board: Board, fill: float, random: np.random.Generator) -> Array:
    """Pose of a board somewhere in a view, as far as the view is wide times 1 / fill."""
    v, u = np.nonzero(rig.labels() == rig.view_names.index(view))
    middle = np.array([[u.mean(), v.mean()]])
    chosen = random.integers(len(u))
    pixel = 0.6 * middle + 0.4 * np.array([[u[chosen], v[chosen]]])
    origin, direction = rig.ray(view, pixel)
    distance = rig.camera.fx * max(board.size) / (fill * np.sqrt(len(u)))
    return facing(board, origin[0], direction[0], distance, random)


def walk(rig: Rig, set: BoardSet, photos: int, seed: int = 0, fill: float = 0.9) -> list[dict[int, Array]]:
    """Poses of boards in the rig frame: fixed ones stand round a rig that moves, others anew a photo."""
    random = np.random.default_rng(seed)
    views = list(rig.views)

    def stand() -> dict[int, Array]:
        first = int(random.integers(len(views)))
        return {
            b: in_view(rig, views[(first + b) % len(views)], board, fill, random)
            for b, board in enumerate(set.boards)
        }

    if not set.fixed:
        return [stand() for _ in range(photos)]
    world = {
        b: in_view(rig, views[b % len(views)], board, fill, random) for b, board in enumerate(set.boards)
    }
    out = []
    for k in range(photos):
        yaw = 2.4 * k  # the golden angle: no two photos alike
        turn = np.r_[random.normal(0, 0.12, 2), yaw, random.normal(0, 0.12, 3)]
        turned = se3.exp(np.r_[0, 0, turn[2], 0, 0, 0])
        nudged = se3.exp(np.r_[turn[:2], 0, turn[3:]])
        out.append({b: nudged @ turned @ T for b, T in world.items()})
    return out


def sightings_of(rig: Rig, set: BoardSet, photos: int, noise: float, seed: int = 0) -> list[Sighting]:
    """Sightings of such a walk."""
    return projected_sightings(rig, set, walk(rig, set, photos, seed), noise, seed)


def disturbed(rig: Rig, tilt_deg: float, shift: float, focal: float, seed: int) -> Rig:
    """The rig with each mirror tilted and shifted that much in some direction, and another focal length."""
    random = np.random.default_rng(seed)
    mirrors = {name: _moved(m, tilt_deg, shift, random) for name, m in rig.mirrors.items()}
    factor = 1.0 + focal * (1.0 if random.random() < 0.5 else -1.0)
    camera = replace(rig.camera, fx=rig.camera.fx * factor, fy=rig.camera.fy * factor)
    return replace(rig, mirrors=mirrors, camera=camera)


def _moved(mirror: Mirror, tilt_deg: float, shift: float, random: np.random.Generator) -> Mirror:
    axis = np.cross(mirror.normal, random.standard_normal(3))
    axis *= np.radians(tilt_deg) / np.linalg.norm(axis)
    R = se3.exp(np.r_[axis, 0, 0, 0])[:3, :3]
    pivot = mirror.offset * mirror.normal if mirror.polygon is None else mirror.polygon.mean(axis=0)
    moved = pivot + shift * (1.0 if random.random() < 0.5 else -1.0) * mirror.normal
    T = se3.from_rotation_translation(R, moved - R @ pivot)
    normal = R @ mirror.normal
    polygon = None if mirror.polygon is None else se3.transform(T, mirror.polygon)
    return replace(mirror, normal=normal, offset=float(normal @ moved), polygon=polygon)


def with_lens(rig: Rig, camera: Camera) -> Rig:
    """The rig with another camera at the same place."""
    return replace(rig, camera=camera)


def nudge(board: Board, shift: float, degrees: float, seed: int = 0) -> Array:
    """Motion (4, 4) in a board's own frame: its middle moves by metres, and it turns about it."""
    random = np.random.default_rng(seed)
    axis, way = (v / np.linalg.norm(v) for v in random.standard_normal((2, 3)))
    R = se3.exp(np.r_[np.radians(degrees) * axis, 0, 0, 0])[:3, :3]
    middle = np.array([*board.size, 0.0]) / 2
    return se3.from_rotation_translation(R, middle + shift * way - R @ middle)
