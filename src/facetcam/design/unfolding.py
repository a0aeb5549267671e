"""Mirrors and the camera's body seen through the first mirrors of a chain, as if light went straight on."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from facetcam.design.spec import Body
from facetcam.geometry import se3
from facetcam.rig import Mirror, Rig

Array = NDArray[np.float64]

_WALL = 1e3  # metres from the middle to the side of the square that stands for an unbounded mirror


@dataclass(eq=False)
class Unfolding:
    """Mirrors and body seen through the first mirrors of a chain, as if light went straight on."""

    rig: Rig
    body: Body | None
    _known: dict[tuple[str, ...], tuple[dict[str, Array], list[Array]]] = field(default_factory=dict)

    def through(self, chain: tuple[str, ...]) -> tuple[dict[str, Array], list[Array]]:
        """Homogeneous corners (N, 4), in the camera frame, of all mirrors and of the body's near faces."""
        if chain not in self._known:
            T = self.rig.T_rig_cam
            for name in chain:
                T = self.rig.mirrors[name].reflection @ T
            T_cam_rig = se3.inverse(T)
            mirrors = {
                name: _homogeneous(se3.transform(T_cam_rig, bounded(mirror, self.rig.T_rig_cam)))
                for name, mirror in self.rig.mirrors.items()
            }
            self._known[chain] = mirrors, list(self._body_faces(T_cam_rig)) if chain else []
        return self._known[chain]

    def _body_faces(self, T_cam_rig: Array) -> Iterator[Array]:
        if self.body is None:
            return
        middle = se3.transform(T_cam_rig @ self.rig.T_rig_cam, [(0.0, 0.0, -self.body.depth / 2)])[0]
        for face in body_faces(self.body):
            seen = se3.transform(T_cam_rig @ self.rig.T_rig_cam, face)
            centre = seen.mean(axis=0)
            if centre @ (centre - middle) < 0:  # it faces the camera; the others are behind these
                yield _homogeneous(seen)


def body_faces(body: Body) -> list[Array]:
    """The six faces (4, 3) of the camera's body in the camera frame."""
    x, y, z = body.width / 2, body.height / 2, body.depth
    near = np.array([(-x, -y, 0.0), (x, -y, 0.0), (x, y, 0.0), (-x, y, 0.0)])
    far = near - (0.0, 0.0, z)
    sides = [np.array([near[i], near[(i + 1) % 4], far[(i + 1) % 4], far[i]]) for i in range(4)]
    return [near, far, *sides]


def bounded(mirror: Mirror, T_rig_cam: Array) -> Array:
    """Corners of a mirror; of an unbounded one, a square too large to matter, opposite the camera."""
    if mirror.polygon is not None:
        return mirror.polygon
    foot = T_rig_cam[:3, 3] + (mirror.offset - mirror.normal @ T_rig_cam[:3, 3]) * mirror.normal
    across = np.cross(mirror.normal, np.eye(3)[np.argmin(np.abs(mirror.normal))])
    across /= np.linalg.norm(across)
    along = np.cross(mirror.normal, across)
    signs = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    square: Array = foot + _WALL * signs @ np.stack([across, along])
    return square


def beyond(corners: Array) -> Array:
    """The half space (4,) on the far side of a polygon's plane from the camera, in the origin."""
    points = corners[:, :3]
    normal = np.cross(points[1] - points[0], points[2] - points[0])
    normal /= np.linalg.norm(normal)
    offset = normal @ points[0]
    return np.append(normal, -offset) * (1.0 if offset >= 0 else -1.0)


def _homogeneous(points: Array) -> Array:
    return np.column_stack([points, np.ones(len(points))])
