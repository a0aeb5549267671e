"""Map points with their appearance: patches that face the camera which first saw them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from facetcam.features.descriptors import DESCRIPTOR_BYTES
from facetcam.slam.camera.optics import Optics
from facetcam.slam.camera.patches import PATCH_SIZE
from facetcam.slam.camera.sight import Sights, Views

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_CAPACITY = 1024  # points at first; doubled when full


class Points:
    """Map points as arrays that grow; row i is point i for ever.

    Attributes
    ----------
    xyz : (N, 3) world position, metres
    patch : (N, P, P) uint8 appearance on the raw frame where the point was first seen
    offset : (N, 2) float32 feature position from the central pixel of the patch
    tangent : (N, 3, 2) world steps that moved the feature by about a pixel in x and y there
    jacobian : (N, 2, 2) pixels that these steps made
    edge : (N, 2) in these steps, the edge in the patch; see `patch_edges`
    descriptor : (N, D) uint8
    colour : (N, 3) uint8 RGB
    repeated : (N,) bool, another corner of its view looked the same
    alive : (N,) bool
    predicted, found : (N,) how often the point was expected in a view, and measured there
    """

    xyz: Array
    patch: NDArray[np.uint8]
    offset: NDArray[np.float32]
    tangent: Array
    jacobian: Array
    edge: Array
    descriptor: NDArray[np.uint8]
    colour: NDArray[np.uint8]
    repeated: NDArray[np.bool_]
    alive: NDArray[np.bool_]
    predicted: NDArray[np.int32]
    found: NDArray[np.int32]

    def __init__(self) -> None:
        self._count = 0
        self._storage: dict[str, NDArray[Any]] = {
            "xyz": np.zeros((_CAPACITY, 3)),
            "patch": np.zeros((_CAPACITY, PATCH_SIZE, PATCH_SIZE), np.uint8),
            "offset": np.zeros((_CAPACITY, 2), np.float32),
            "tangent": np.zeros((_CAPACITY, 3, 2)),
            "jacobian": np.zeros((_CAPACITY, 2, 2)),
            "edge": np.zeros((_CAPACITY, 2)),
            "descriptor": np.zeros((_CAPACITY, DESCRIPTOR_BYTES), np.uint8),
            "colour": np.zeros((_CAPACITY, 3), np.uint8),
            "repeated": np.zeros(_CAPACITY, np.bool_),
            "alive": np.zeros(_CAPACITY, np.bool_),
            "predicted": np.zeros(_CAPACITY, np.int32),
            "found": np.zeros(_CAPACITY, np.int32),
        }
        self._expose()

    def __len__(self) -> int:
        return self._count

    def join(self, other: Points) -> int:
        """Add all points of another map, dead ones too; returns by how much larger their ids are here."""
        ahead = len(self)
        ids = self.extend(**{name: column[: len(other)] for name, column in other._storage.items()})
        self.alive[ids] = other.alive
        return ahead

    def sights(
        self, ids: NDArray[np.integer], views: Views, plane: Array, T_world_rig: Array, optics: Optics
    ) -> Sights:
        """What is seen of points through views (N,), at (N, 2) on their pinholes, from near a pose."""
        seen = Sights.of_corners(self.xyz[ids], views, plane)
        return seen.on_edges(self.edges(ids), T_world_rig, optics)

    def edges(self, ids: NDArray[np.integer]) -> Array:
        """Edges (N, 3) of the world on which points lie, as long as those in their patches."""
        along = np.einsum("nij,nj->ni", self.tangent[ids], self.edge[ids])
        length = np.maximum(np.linalg.norm(along, axis=1), 1e-12)
        return np.asarray(along * (np.linalg.norm(self.edge[ids], axis=1) / length)[:, None])

    def _expose(self) -> None:
        """The public columns are views of the rows in use."""
        for name, column in self._storage.items():
            setattr(self, name, column[: self._count])

    def extend(self, **columns: NDArray[Any]) -> Index:
        """Add points; returns their ids."""
        ids = np.arange(self._count, self._count + len(columns["xyz"]))
        self._count += len(ids)
        while self._count > len(self._storage["xyz"]):
            self._storage = {n: np.concatenate([c, np.zeros_like(c)]) for n, c in self._storage.items()}
        for name, values in columns.items():
            self._storage[name][ids] = values
        self._storage["alive"][ids] = True
        self._expose()
        return ids


def tangents(points_rig: Array, views: NDArray[np.int8], optics: Optics) -> Array:
    """Two steps (N, 3, 2) of a pixel across each viewing ray: the patch is taken to face the camera."""
    rays = points_rig - optics.origins(views)
    depth = np.linalg.norm(rays, axis=1)
    rays = rays / depth[:, None]
    aside = np.cross(rays, optics.T_rig_view[views][:, :3, 1])
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    step = np.stack([aside, np.cross(rays, aside)], axis=-1)
    return np.asarray(step * (depth / optics.focal)[:, None, None])
