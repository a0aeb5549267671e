"""The broken rays of a raw frame: from the lens by every mirror they meet to the room, valid or stray."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from facetcam.rig import Rig
from facetcam.rig.tracing import Tracer

Array = NDArray[np.float64]
Array32 = NDArray[np.float32]

BOUNCES = 6  # mirrors that a ray meets at most; what goes on is dark


@dataclass(frozen=True, eq=False, slots=True)
class Hops:
    """Straight pieces of rays, in the rig frame.

    Attributes
    ----------
    ray : (M,) array
        Index of the ray.
    start, direction : (M, 3) float32 arrays
        Metres; unit vectors.
    travelled, limit : (M,) float32 arrays
        Metres before the start, and from there to the next mirror; inf after the last.
    """

    ray: NDArray[np.intp]
    start: Array32
    direction: Array32
    travelled: Array32
    limit: Array32


class RigPaths:
    """Rays of one rig.

    Parameters
    ----------
    rig : Rig
    body : float
        Radius in metres of the camera's body, a black ball round the lens that mirrors may show.
    stray : bool
        Whether rays that belong to no view are followed as in the real rig; else those pixels are dark.
    """

    def __init__(self, rig: Rig, body: float = 0.0, stray: bool = True) -> None:
        self.rig, self.body, self.stray = rig, body, stray
        self._mirrors = list(rig.mirrors.values())
        self._normals = np.array([m.normal for m in self._mirrors]).reshape(-1, 3)
        self._labels = rig.labels()
        corners = [m.polygon for m in self._mirrors if m.polygon is not None]
        self.bounded = len(corners) == len(self._mirrors)
        points = np.concatenate([rig.T_rig_cam[None, :3, 3], *corners])
        self.radius = float(np.linalg.norm(points - rig.T_rig_cam[:3, 3], axis=1).max())

    def hops(self, pixels: Array, lens: Array, focus: float, only_last: bool) -> list[Hops]:
        """Follow rays from a point of the lens.

        Parameters
        ----------
        pixels : (N, 2) array
        lens : (2,) array
            Point of the aperture, metres right and down of its middle.
        focus : float
            Metres from the lens at which rays of all its points meet.
        only_last : bool
            Leave out the pieces between mirrors, where nothing stands in the way.

        Returns
        -------
        list of Hops, in the order in which the rays run them
        """
        camera = self.rig.camera.ray(pixels)
        alive = np.flatnonzero(np.any(camera != 0.0, axis=1))
        if not self.stray:
            u, v = np.rint(pixels[alive]).astype(int).T
            inside = (
                self._labels[v.clip(0, self.rig.camera.height - 1), u.clip(0, self.rig.camera.width - 1)] >= 0
            )
            alive = alive[inside]
        T = self.rig.T_rig_cam.copy()
        T[:3, 3] += T[:3, 0] * lens[0] + T[:3, 1] * lens[1]
        aims = _through(camera[alive], lens, focus)
        paths = Tracer(self._mirrors, T).trace(aims, BOUNCES)
        position = np.broadcast_to(T[:3, 3], aims.shape).copy()
        direction, travelled = aims @ T[:3, :3].T, np.zeros(len(aims))
        pieces = []
        for bounce in range(BOUNCES):
            met = paths.mirror[bounce] >= 0
            limit = np.where(met, paths.length[bounce] - travelled, np.inf)
            dark = self._meets_body(position, direction, limit) if bounce else np.zeros(len(aims), bool)
            pick = ~dark & ~met if only_last else ~dark
            pieces.append(_hops(alive, position, direction, travelled, limit, pick))
            on = met & ~dark
            alive, paths = alive[on], replace(paths, mirror=paths.mirror[:, on], length=paths.length[:, on])
            step, normal = limit[on, None], self._normals[paths.mirror[bounce]]
            position = position[on] + step * direction[on]
            direction = direction[on] - 2.0 * np.sum(direction[on] * normal, axis=1, keepdims=True) * normal
            travelled = travelled[on] + step[:, 0]
            aims = direction
            if not len(alive):
                break
        return [piece for piece in pieces if len(piece.ray)]

    def _meets_body(self, position: Array, direction: Array, limit: Array) -> NDArray[np.bool_]:
        away = self.rig.T_rig_cam[:3, 3] - position
        along = np.sum(away * direction, axis=1)
        apart = np.sum(away * away, axis=1) - along**2
        return np.asarray((along > 0) & (along < limit) & (apart < self.body**2))


def _through(rays: Array, lens: Array, focus: float) -> Array:
    """Unit directions from a point of the lens to where rays from its middle are in focus."""
    if not np.any(lens):
        return rays
    aims = focus * rays / rays[:, 2:] - (lens[0], lens[1], 0.0)
    return np.asarray(aims / np.linalg.norm(aims, axis=1, keepdims=True))


def _hops(
    ray: NDArray[np.intp],
    start: Array,
    direction: Array,
    travelled: Array,
    limit: Array,
    pick: NDArray[np.bool_],
) -> Hops:
    return Hops(
        ray[pick],
        start[pick].astype(np.float32),
        direction[pick].astype(np.float32),
        travelled[pick].astype(np.float32),
        limit[pick].astype(np.float32),
    )
