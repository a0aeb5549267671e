"""Follow camera rays from mirror to mirror."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from facetcam import _core
from facetcam.rig.mirrors import Mirror

Array = NDArray[np.float64]

LEAVES = -1  # the ray meets no further mirror
NOWHERE = -2  # there is no ray: the lens gives the pixel none, or it is lost in the edge of a mirror's glass


@dataclass(frozen=True, eq=False)
class Paths:
    """The mirrors that N rays meet, up to B bounces each.

    Attributes
    ----------
    mirror : (B, N) int8 array
        Index of the mirror of each bounce; LEAVES after the last one, NOWHERE for a ray that does not exist.
    length : (B, N) array
        Metres along the broken path from the camera to each bounce; inf where there is none. Reflection
        keeps lengths, so this is also the straight distance from a view's virtual centre. The way through
        glass counts as `geometry.glass.slant`, which makes it the distance from where the ray seems to start.
    """

    mirror: NDArray[np.int8]
    length: Array

    def met(self, chain: Sequence[int]) -> NDArray[np.bool_]:
        """Tell which rays meet exactly the mirrors of `chain`, in order, before anything else."""
        reached: NDArray[np.bool_] = self.mirror[len(chain)] != NOWHERE
        for bounce, index in enumerate(chain):
            reached &= self.mirror[bounce] == index
        return reached


class Tracer:
    """Flat mirrors made ready for tracing the rays of one camera.

    Parameters
    ----------
    mirrors : sequence of Mirror
        Their order gives the indices in `Paths.mirror`.
    T_rig_cam : (4, 4) array
        Pose of the camera in the frame of the mirrors.
    """

    def __init__(self, mirrors: Sequence[Mirror], T_rig_cam: Array) -> None:
        planes = np.array([(*mirror.normal, mirror.offset) for mirror in mirrors]).reshape(-1, 4)
        panes = [(m.glass.thickness, m.glass.index) if m.glass else (0.0, 1.0) for m in mirrors]
        self._glass = np.array(panes, dtype=np.float64).reshape(-1, 2)
        bounds = [mirror.half_spaces for mirror in mirrors]
        self._planes = _in_camera(planes, T_rig_cam)
        self._bounds = _in_camera(np.concatenate([np.empty((0, 4)), *bounds]), T_rig_cam)
        self._starts = np.cumsum([0, *map(len, bounds)], dtype=np.int32)

    def trace(self, directions: ArrayLike, bounces: int) -> Paths:
        """Follow camera rays, unit directions (N, 3) in the camera frame, through up to `bounces` mirrors."""
        aims = np.ascontiguousarray(directions, dtype=np.float64)
        return Paths(*_core.trace_rays(self._planes, self._glass, self._bounds, self._starts, aims, bounces))


def _in_camera(planes: Array, T_rig_cam: Array) -> Array:
    """Planes, rows (a, b, c, d) of a x + b y + c z = d in the rig frame, as planes of the camera frame."""
    normals = planes[:, :3]
    return np.column_stack([normals @ T_rig_cam[:3, :3], planes[:, 3] - normals @ T_rig_cam[:3, 3]])
