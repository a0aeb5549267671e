"""The tables of a mesh as the core reads them: triangles, materials, texels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from facetcam import _core
from facetcam.simulation.mesh_light import Lattices
from facetcam.simulation.meshes import Mesh, within_memory
from facetcam.simulation.mipmaps import pack_mipmaps

Array32 = NDArray[np.float32]

_NO_PICTURE = np.zeros((1, 1, 3), dtype=np.uint8)
_NO_TINTS = np.zeros((0, 3), dtype=np.uint8)
_TRIANGLE = np.dtype(
    [
        ("corner", np.int32, 3),
        ("normal", np.float32, 3),
        ("density", np.float32),
        ("material", np.int32),
        ("lattice", np.int32),
        ("steps", np.int32),
    ]
)
_MATERIAL = np.dtype(
    [
        ("texture", np.int32, 4),
        ("colour", np.float32, 3),
        ("glow", np.float32),
        ("glow_texture", np.int32, 4),
    ]
)


def shader_of(mesh: Mesh, places: Lattices) -> tuple[_core.TriangleShader, int]:
    """What shades hits on a mesh whose light is known at places; and how many pictures are coarser for it."""
    distinct = {id(picture): picture for m in mesh.materials for picture in m.pictures}
    pictures, coarser = within_memory(list(distinct.values()))
    texels, layout = pack_mipmaps(pictures)
    order = {key: index for index, key in enumerate(distinct)}
    materials = np.zeros(len(mesh.materials), dtype=_MATERIAL)
    for column, field in enumerate(("texture", "glow_texture")):
        materials[field] = layout[[order[id(m.pictures[column])] for m in mesh.materials]]
    materials["colour"] = [m.colour for m in mesh.materials]
    materials["glow"] = [m.glow for m in mesh.materials]
    shader = _core.TriangleShader(
        _bytes(_triangles(mesh, places, materials["texture"])),
        np.ascontiguousarray(mesh.uv, dtype=np.float32),
        _bytes(materials),
        texels,
        _NO_TINTS if mesh.tints is None else mesh.tints,
        len(places.place),
    )
    return shader, coarser


def without_pictures(mesh: Mesh) -> Mesh:
    """The mesh once its pictures live on in the table of texels."""
    bare = tuple(replace(m, picture=_NO_PICTURE, glow_picture=None) for m in mesh.materials)
    return replace(mesh, materials=bare)


def _triangles(mesh: Mesh, places: Lattices, textures: NDArray[np.int32]) -> NDArray[np.void]:
    triangles = np.zeros(len(mesh.faces), dtype=_TRIANGLE)
    triangles["corner"], triangles["material"] = mesh.faces, mesh.material
    triangles["lattice"], triangles["steps"] = places.first, places.steps
    triangles["normal"], area = _normals(mesh)
    size = textures[mesh.material, 1:3].astype(np.float64)
    triangles["density"] = np.sqrt(_uv_area(mesh) * size.prod(axis=1) / area)
    return triangles


def _bytes(rows: NDArray[np.void]) -> NDArray[np.uint8]:
    return rows.view(np.uint8).reshape(-1, rows.itemsize)


def _normals(mesh: Mesh) -> tuple[Array32, NDArray[np.float64]]:
    """Unit normals (T, 3) and areas (T,) of triangles."""
    a, b, c = mesh.vertices[mesh.faces].astype(np.float64).transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    length = np.maximum(np.linalg.norm(normal, axis=1), 1e-18)
    return (normal / length[:, None]).astype(np.float32), length / 2


def _uv_area(mesh: Mesh) -> NDArray[np.float64]:
    a, b, c = mesh.uv[mesh.faces].astype(np.float64).transpose(1, 0, 2)
    (x1, y1), (x2, y2) = (b - a).T, (c - a).T
    return np.asarray(np.abs(x1 * y2 - x2 * y1) / 2)
