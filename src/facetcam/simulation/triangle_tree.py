"""Nearest triangle along rays, by the tree of bounding boxes in the core; Embree is quicker where it is."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from facetcam import _core

Array32 = NDArray[np.float32]

# Where rays end: triangle (-1 for none), metres (inf for none), shares of its second and third corner.
HIT = np.dtype([("surface", np.int32), ("distance", np.float32), ("u", np.float32), ("v", np.float32)])
Hits = NDArray[np.void]


class TriangleTree:
    """Triangles made ready for rays.

    Parameters
    ----------
    vertices : (V, 3) array
        Metres.
    faces : (T, 3) array
        Indices of corners.
    threads : int
        The result does not depend on it.
    """

    def __init__(self, vertices: ArrayLike, faces: ArrayLike, threads: int) -> None:
        self.threads = threads
        self._tree = _core.TriangleTree(
            np.ascontiguousarray(vertices, dtype=np.float32), np.ascontiguousarray(faces, dtype=np.int32)
        )

    def trace(self, origins: ArrayLike, directions: ArrayLike, threads: int | None = None) -> Hits:
        """Nearest triangle on either side along rays; `surface` is its index, u and v its place.

        Parameters
        ----------
        origins : (3,) or (N, 3) array
        directions : (N, 3) array
            Unit vectors.
        threads : int, optional

        Returns
        -------
        (N,) array of HIT
        """
        directions = np.ascontiguousarray(directions, dtype=np.float32)
        origins = np.asarray(origins, dtype=np.float32).reshape(-1, 3)
        origins = np.ascontiguousarray(np.broadcast_to(origins, directions.shape))
        return self._cast(origins, directions, threads or self.threads).view(HIT).ravel()

    def _cast(self, origins: Array32, directions: Array32, threads: int) -> NDArray[np.uint8]:
        return self._tree.cast(origins, directions, threads)
