"""Read scenes: glTF and what else trimesh reads, with pictures, colours and opacity."""

from __future__ import annotations

import hashlib
import json
import logging
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from facetcam.errors import FacetcamError, SourceError
from facetcam.simulation.meshes import Material, Mesh, joined

GREY = (200, 200, 200)
MILLIMETRES = 500.0  # a scene longer than so many metres is taken for one in millimetres
SMALLEST = 0.05  # metres; below, a scene is no room


@dataclass(frozen=True, eq=False)
class SceneFile:
    """A scene as read, and what was not as it should be."""

    mesh: Mesh
    warnings: tuple[str, ...]


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
    warnings = _absent_pictures(path)
    meshes, plain = [], 0
    cache: dict[object, Any] = {}
    loaded = _load(path)
    for node in loaded.graph.nodes_geometry:
        T, name = loaded.graph[node]
        geometry = loaded.geometry[name]
        if not len(getattr(geometry, "faces", ())):
            continue
        material = _material(geometry.visual, cache)
        plain += material.picture.size == 3
        meshes.append(_mesh(geometry, np.asarray(T, dtype=np.float64), material))
    if not meshes:
        raise SourceError(f"{path}: no triangle in the scene; export it with its meshes")
    if plain:
        warnings.append(
            f"{path.name}: {plain} of {len(meshes)} meshes have no texture; shown in a flat colour"
        )
    mesh = joined(meshes)
    if not np.isfinite(mesh.vertices).all():
        raise SourceError(f"{path}: a corner is not finite; export the scene again")
    mesh = mesh.turned_up() if up == "y" else mesh
    low, high = mesh.bounds
    length = float(np.max(high - low))
    factor = scale if scale is not None else (1e-3 if length > MILLIMETRES else 1.0)
    if scale is None and factor != 1.0:
        warnings.append(
            f"{path.name}: {length:g} units long, so they are taken for millimetres; --scale 1 keeps metres"
        )
    if not 0.0 < factor < np.inf or length * factor < SMALLEST:
        raise SourceError(f"{path}: {length * factor:g} m long is no room; give --scale, metres a unit")
    return SceneFile(mesh.scaled(factor) if factor != 1.0 else mesh, tuple(warnings))


def _load(path: Path) -> Any:
    try:
        import trimesh
    except ImportError as error:
        raise FacetcamError("simulate: needs trimesh; pip install facetcam[sim]") from error
    if not path.is_file():
        raise SourceError(f"{path}: no such scene file")
    logging.getLogger("trimesh").setLevel(logging.CRITICAL)  # what matters is said in our own words
    try:
        return trimesh.load_scene(path, process=False)
    except Exception as error:  # whatever a broken file makes the reader raise
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise SourceError(f"{path}: not a usable scene ({reason})") from error


def _absent_pictures(path: Path) -> list[str]:
    """Pictures that a `.gltf` names and that are not there."""
    if path.suffix.lower() != ".gltf":
        return []
    try:
        images = json.loads(path.read_text(encoding="utf-8")).get("images", [])
    except (OSError, ValueError, AttributeError):
        return []  # said by the reader
    names = [str(image.get("uri", "")) for image in images]
    absent = [
        n for n in names if n and not n.startswith("data:") and not (path.parent / unquote(n)).is_file()
    ]
    if not absent:
        return []
    more = f" and {len(absent) - 1} more" if len(absent) > 1 else ""
    return [f"{path.name}: texture {absent[0]}{more} is missing; shown in a flat colour"]


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


def _material(visual: Any, cache: dict[object, Any]) -> Material:
    """The material of a trimesh visual; each one and its picture are made once."""
    source = getattr(visual, "material", None)
    if source is None:  # colours of vertices or faces
        colour = np.asarray(getattr(visual, "main_color", (*GREY, 255)))[:3]
        return Material(np.full((1, 1, 3), colour, dtype=np.uint8))
    if id(source) not in cache:
        material = _painted(source)
        # Copies of a piece of furniture bring copies of its picture.
        key = hashlib.sha256(material.picture.tobytes()).digest(), material.picture.shape
        cache[id(source)] = replace(material, picture=cache.setdefault(key, material.picture))
    made: Material = cache[id(source)]
    return made


def _painted(source: Any) -> Material:
    image = getattr(source, "baseColorTexture", None)
    image = getattr(source, "image", None) if image is None else image
    factor = getattr(source, "baseColorFactor", None)
    factor = getattr(source, "diffuse", None) if factor is None and image is None else factor
    colour = np.ones(4) if factor is None else _unit(factor)
    emissive = getattr(source, "emissiveFactor", None)
    glow = 0.0 if emissive is None else float(np.mean(_unit(emissive)[:3]))
    mode = str(getattr(source, "alphaMode", None) or "OPAQUE").upper()
    if image is None:
        opacity = np.full((1, 1), round(255 * colour[3]), dtype=np.uint8)
        if factor is None:
            picture = np.full((1, 1, 3), GREY, dtype=np.uint8)
        else:  # trimesh keeps colours as bytes; they are linear in glTF, our pictures are roots
            picture = np.rint(255 * np.sqrt(colour[:3])).astype(np.uint8).reshape(1, 1, 3)
        colour = np.ones(4)
    else:
        rgba = np.asarray(image.convert("RGBA"))
        picture = np.ascontiguousarray(rgba[..., :3])
        opacity = np.rint(rgba[..., 3] * colour[3]).astype(np.uint8)
    clear = mode != "OPAQUE" and bool((opacity < 255).any())
    cutoff = float(getattr(source, "alphaCutoff", None) or 0.5) if mode == "MASK" else None
    r, g, b = (float(c) for c in colour[:3])
    return Material(picture, (r, g, b), opacity if clear else None, cutoff, glow)


def _unit(colour: Any) -> NDArray[np.float64]:
    """A colour of bytes or shares as shares, with opacity."""
    values = np.asarray(colour)
    shares = values / 255.0 if values.dtype == np.uint8 or values.max() > 1 else values.astype(np.float64)
    return np.append(shares, np.ones(4))[:4] if len(shares) < 4 else shares[:4]
