"""What is odd about a path through a scene: outside, through walls, too close."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from facetcam.simulation.mesh_renderer import MeshRenderer

Array = NDArray[np.float64]

ROUND = 26  # directions in which a place is searched for what is close
TOO_CLOSE = 0.02  # metres


def path_warnings(renderer: MeshRenderer, times: Array, poses: Array) -> list[str]:
    """Say where poses (N, 4, 4) leave the scene, pass through a surface, or stand in one."""
    place = poses[:, :3, 3]
    low, high = renderer.mesh.bounds
    warnings = []
    outside = np.any((place < low) | (place > high), axis=1)
    warnings += _said("the path is outside the scene", times[outside])
    step = np.diff(place, axis=0)
    length = np.linalg.norm(step, axis=1)
    moving = np.flatnonzero(length > 1e-9)
    if len(moving):
        hits = renderer.trace(place[moving], step[moving] / length[moving, None])
        through = moving[hits["distance"] <= length[moving]]
        warnings += _said("the path passes through a surface", times[through])
    close = np.zeros(len(place), dtype=bool)
    for direction in _around():
        hits = renderer.trace(place, np.broadcast_to(direction, place.shape))
        close |= hits["distance"] < TOO_CLOSE
    warnings += _said(f"the rig stands in a wall, or within {100 * TOO_CLOSE:g} cm of one,", times[close])
    return warnings


def _said(what: str, times: Array) -> list[str]:
    if not len(times):
        return []
    more = f" and in {len(times) - 1} more frames" if len(times) > 1 else ""
    return [f"{what} at {times[0]:.2f} s{more}"]


def _around() -> Array:
    grid = np.array(np.meshgrid(*3 * [[-1.0, 0.0, 1.0]])).reshape(3, -1).T
    grid = grid[np.any(grid != 0, axis=1)]
    return np.asarray(grid / np.linalg.norm(grid, axis=1, keepdims=True))
