"""Read scenes: glTF and what else trimesh reads, with pictures, colours and opacity."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from facetcam.errors import FacetcamError, SourceError
from facetcam.simulation import gltf, wavefront
from facetcam.simulation.meshes import Material, Mesh, joined
from facetcam.simulation.scene_materials import material_of, tints_of
from facetcam.simulation.settings import LampSettings

MILLIMETRES = 500.0  # a scene longer than so many metres is taken for one in millimetres
SMALLEST, LARGEST = 0.05, 1e5  # metres; beyond, a scene is no room


@dataclass(frozen=True, eq=False)
class SceneFile:
    """A scene as read, its own lamps, and what was not as it should be."""

    mesh: Mesh
    warnings: tuple[str, ...]
    lamps: tuple[LampSettings, ...] = ()


def read_scene(path: Path, scale: float | None = None, up: str = "z") -> SceneFile:
    """Read a scene.

    Parameters
    ----------
    path : Path
        `.glb`, `.gltf`, or another format of trimesh.
    scale : float, optional
        Metres a unit of the file; found from the size of the scene by default, and said if it is not 1.
    up : str
        `z` or `y`, the axis of the file that points up.

    Raises
    ------
    SourceError
        If the file cannot be read or holds no triangle.
    FacetcamError
        If trimesh is not installed, or the scene is larger than memory is meant for.
    """
    loaded = _load(path)
    content = gltf.header(path)
    meshes, plain = [], 0
    cache: dict[object, Any] = {}
    for node in loaded.graph.nodes_geometry:
        T, name = loaded.graph[node]
        geometry = loaded.geometry[name]
        if not len(getattr(geometry, "faces", ())):
            continue
        material, tints = material_of(geometry.visual, cache), tints_of(geometry.visual, bool(content))
        plain += material.picture.size == 3 and tints is None
        meshes.append(replace(_mesh(geometry, np.asarray(T, dtype=np.float64), material), tints=tints))
    if not meshes:
        raise SourceError(f"{path}: no triangle in the scene; export it with its meshes")
    lamps, warnings = gltf.lamps(content, loaded.graph)
    absent = gltf.absent_pictures(content, path.parent) or wavefront.absent_files(path)
    warnings = [*absent, *gltf.left_out(content), *warnings]
    if plain:
        warnings.append(f"{plain} of {len(meshes)} meshes have no texture; shown in a flat colour")
    mesh = joined(meshes)
    if not np.isfinite(mesh.vertices).all():
        raise SourceError(f"{path}: a corner is not finite; export the scene again")
    mesh = mesh.turned_up() if up == "y" else mesh
    factor, words = _metres_a_unit(path, mesh, scale)
    mesh = mesh.scaled(factor) if factor != 1.0 else mesh
    placed = tuple(_placed(lamp, factor, up) for lamp in lamps)
    return SceneFile(mesh, tuple(f"{path.name}: {text}" for text in warnings + words), placed)


def _metres_a_unit(path: Path, mesh: Mesh, scale: float | None) -> tuple[float, list[str]]:
    """Metres a unit of the file, and what is said of it."""
    low, high = mesh.bounds
    length = float(np.max(high - low))
    factor = scale if scale is not None else (1e-3 if length > MILLIMETRES else 1.0)
    if not 0.0 < factor < np.inf or not SMALLEST <= length * factor <= LARGEST:
        raise SourceError(f"{path}: {length * factor:g} m long is no room; give --scale, metres a unit")
    if scale is not None or factor == 1.0:
        return factor, []
    return factor, [f"{length:g} units long, so they are taken for millimetres; --scale 1 keeps metres"]


def _placed(lamp: LampSettings, factor: float, up: str) -> LampSettings:
    """A lamp in metres, z up, as the mesh."""

    def turned(x: float, y: float, z: float) -> tuple[float, float, float]:
        return (x, -z, y) if up == "y" else (x, y, z)

    x, y, z = turned(*lamp.position)
    facing = None if lamp.facing is None else turned(*lamp.facing)
    return replace(lamp, position=(factor * x, factor * y, factor * z), facing=facing)


def _load(path: Path) -> Any:
    try:
        import trimesh
    except ImportError as error:
        raise FacetcamError("simulate: needs trimesh; pip install facetcam[sim]") from error
    if not path.is_file():
        raise SourceError(f"{path}: no such scene file")
    try:
        fault = gltf.fault(path)
    except OSError as error:
        raise SourceError(f"{path}: {error.strerror}") from error
    if fault:
        raise SourceError(f"{path}: {fault}")
    logging.getLogger("trimesh").setLevel(logging.CRITICAL)  # what matters is said in our own words
    try:
        return trimesh.load_scene(path, process=False)
    except Exception as error:  # whatever a broken file makes the reader raise
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise SourceError(f"{path}: not a usable scene ({reason}); export it as .glb") from error


def _mesh(geometry: Any, T: NDArray[np.float64], material: Material) -> Mesh:
    vertices = np.asarray(geometry.vertices) @ T[:3, :3].T + T[:3, 3]
    faces = np.asarray(geometry.faces)
    mirrored = np.linalg.det(T[:3, :3]) < 0
    # Normals turn with the inverse transpose; faces of a mirrored mesh turn the other way.
    normals = np.asarray(geometry.vertex_normals) @ np.linalg.pinv(T[:3, :3])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    uv = getattr(geometry.visual, "uv", None)
    # trimesh counts v from below.
    uv = np.zeros((len(vertices), 2)) if uv is None else np.asarray(uv)[:, :2] * (1, -1) + (0, 1)
    return Mesh(
        vertices.astype(np.float32),
        (faces[:, ::-1] if mirrored else faces).astype(np.int32),
        normals.astype(np.float32),
        np.nan_to_num(uv).astype(np.float32),
        np.zeros(len(faces), dtype=np.int32),
        (material,),
    )
