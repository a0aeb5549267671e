"""Nearest triangle along rays, by Embree.

The package `embreex` carries Embree; its own ray loop holds Python's lock, so the core runs the loop and
takes from `embreex` the library alone.
"""

from __future__ import annotations

import ctypes
import importlib.util
import sys
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from facetcam import _core
from facetcam.errors import FacetcamError
from facetcam.simulation.triangle_tree import TriangleTree

Array32 = NDArray[np.float32]

# Constants of Embree 4: rtcore_geometry.h, rtcore_common.h, rtcore_scene.h.
_TRIANGLES, _INDICES, _VERTICES = 0, 0, 1
_UINT3, _FLOAT3 = 0x5003, 0x9003
_ROBUST = 4  # no ray slips through the edge of two triangles


def installed() -> bool:
    """Tell whether Embree is there; it has no package for Linux on ARM."""
    return importlib.util.find_spec("embreex") is not None


@cache
def _library() -> ctypes.CDLL:
    """Embree, reached through the module of `embreex` that was linked with it."""
    try:
        import embreex.rtcore_scene as linked
    except ImportError as error:
        raise FacetcamError("simulate: needs Embree; pip install facetcam[sim]") from error
    try:
        library = ctypes.CDLL(linked.__file__)
        pointer, number = ctypes.c_void_p, ctypes.c_uint
        for name, result, arguments in (
            ("rtcNewDevice", pointer, [ctypes.c_char_p]),
            ("rtcNewScene", pointer, [pointer]),
            ("rtcNewGeometry", pointer, [pointer, number]),
            (
                "rtcSetNewGeometryBuffer",
                pointer,
                [pointer, number, number, number, ctypes.c_size_t, ctypes.c_size_t],
            ),
            ("rtcCommitGeometry", None, [pointer]),
            ("rtcAttachGeometry", number, [pointer, pointer]),
            ("rtcReleaseGeometry", None, [pointer]),
            ("rtcSetSceneFlags", None, [pointer, number]),
            ("rtcCommitScene", None, [pointer]),
            ("rtcReleaseScene", None, [pointer]),
            ("rtcReleaseDevice", None, [pointer]),
            ("rtcIntersect1", None, [pointer, pointer, pointer]),
        ):
            function = getattr(library, name)
            function.restype, function.argtypes = result, arguments
    except (OSError, AttributeError) as error:
        raise FacetcamError(f"simulate: this build of embreex cannot be used on {sys.platform}") from error
    return library


class EmbreeTree(TriangleTree):
    """Triangles made ready for rays by Embree.

    Raises
    ------
    FacetcamError
        If Embree is not installed or has no room for the scene.
    """

    def __init__(self, vertices: ArrayLike, faces: ArrayLike, threads: int) -> None:
        self.threads = threads
        self._embree = embree = _library()
        self._address = int(ctypes.cast(embree.rtcIntersect1, ctypes.c_void_p).value or 0)
        self._device = embree.rtcNewDevice(None)
        self._scene = embree.rtcNewScene(self._device)
        embree.rtcSetSceneFlags(self._scene, _ROBUST)
        geometry = embree.rtcNewGeometry(self._device, _TRIANGLES)
        self._fill(geometry, _VERTICES, _FLOAT3, np.asarray(vertices, dtype=np.float32))
        self._fill(geometry, _INDICES, _UINT3, np.asarray(faces, dtype=np.uint32))
        embree.rtcCommitGeometry(geometry)
        embree.rtcAttachGeometry(self._scene, geometry)
        embree.rtcReleaseGeometry(geometry)
        embree.rtcCommitScene(self._scene)

    def _fill(self, geometry: int, kind: int, layout: int, rows: NDArray[np.generic]) -> None:
        rows = np.ascontiguousarray(rows)
        buffer = self._embree.rtcSetNewGeometryBuffer(geometry, kind, 0, layout, 12, len(rows))
        if not buffer:
            raise FacetcamError(f"scene: no memory for {len(rows)} triangles or corners; simplify the scene")
        ctypes.memmove(buffer, rows.ctypes.data, rows.nbytes)

    def _cast(self, origins: Array32, directions: Array32, threads: int) -> NDArray[np.uint8]:
        return _core.cast_by_embree(self._address, self._scene, origins, directions, threads)

    def __del__(self) -> None:
        if getattr(self, "_scene", None):
            self._embree.rtcReleaseScene(self._scene)
            self._embree.rtcReleaseDevice(self._device)
