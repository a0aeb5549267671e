"""What glTF scenes say besides their meshes: lamps, and what a renderer of matt pictures leaves out."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterable
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from facetcam.simulation.settings import LampSettings

Array = NDArray[np.float64]

LIGHTS = "KHR_lights_punctual"
HONOURED = {LIGHTS, "KHR_draco_mesh_compression", "EXT_texture_webp"}
MAPS = {"normalTexture": "normal maps", "occlusionTexture": "occlusion maps"}
MOST_LAMPS = 16


def header(path: Path) -> dict[str, Any]:
    """The JSON of a `.gltf` or `.glb` file; empty where there is none (the reader of meshes complains)."""
    try:
        if path.suffix.lower() == ".gltf":
            found = json.loads(path.read_text(encoding="utf-8"))
        elif path.suffix.lower() == ".glb":
            with path.open("rb") as file:
                length = struct.unpack("<12xI4x", file.read(20))[0]
                found = json.loads(file.read(length))
        else:
            return {}
    except (OSError, ValueError, struct.error):
        return {}
    return found if isinstance(found, dict) else {}


def fault(path: Path) -> str | None:
    """Say what keeps a scene from being read at all, and what to do; None where nothing is seen yet."""
    size = path.stat().st_size
    if not size:
        return "empty file; export the scene again"
    if path.suffix.lower() == ".gltf":
        content = header(path)
        if not content:
            return "not a glTF text file (JSON); export the scene as .glb"
        absent = _absent(content.get("buffers", []), path.parent)
        if absent:
            return f"{absent[0]} is missing; put it beside the scene, or export the scene as .glb"
    if path.suffix.lower() == ".glb":
        with path.open("rb") as file:
            magic, length = struct.unpack("<4s4xI", file.read(12).ljust(12, b"\0"))
        if magic != b"glTF":
            return "not a glTF binary; export the scene as .glb"
        if size < max(length, 20):
            return f"cut short, {size} of {length} bytes; export or copy the scene again"
    return None


def left_out(content: dict[str, Any]) -> list[str]:
    """Say what a glTF file asks for and will not get, in one line if any."""
    named = []
    materials = content.get("materials", [])
    for key, words in MAPS.items():
        count = sum(key in material for material in materials)
        named += [f"{words} ({count} materials)"] if count else []
    named += [name for name in ("skins", "animations") if content.get(name)]
    named += sorted(set(content.get("extensionsUsed", [])) - HONOURED)
    return [f"not simulated: {', '.join(named)}"] if named else []


def absent_pictures(content: dict[str, Any], folder: Path) -> list[str]:
    """Say which picture files are named and not there."""
    absent = _absent(content.get("images", []), folder)
    if not absent:
        return []
    more = f" and {len(absent) - 1} more" if len(absent) > 1 else ""
    return [f"texture {absent[0]}{more} is missing; shown in a flat colour"]


def _absent(entries: list[dict[str, Any]], folder: Path) -> list[str]:
    """Files that entries of glTF name and that are not there."""
    names = [str(entry.get("uri", "")) for entry in entries]
    return [n for n in names if n and not n.startswith("data:") and not (folder / unquote(n)).is_file()]


def lamps(content: dict[str, Any], graph: Any) -> tuple[list[LampSettings], list[str]]:
    """Lamps of KHR_lights_punctual in the scene's own unit and axes, brightest first, and what is said.

    Parameters
    ----------
    content : dict
        From `header`.
    graph : trimesh.scene.transforms.SceneGraph
        Places of the nodes.
    """
    lights = content.get("extensions", {}).get(LIGHTS, {}).get("lights", [])
    found, suns = [], 0
    for node in graph.nodes:
        index = _light_of(graph, node)
        if index is None or not 0 <= index < len(lights):
            continue
        light = lights[index]
        if light.get("type") == "directional":
            suns += 1
            continue
        T = np.asarray(graph[node][0], dtype=np.float64)
        facing = _three(-T[:3, 2]) if light.get("type") == "spot" else None
        colour = _three(light.get("color", (1.0, 1.0, 1.0)))
        found.append(LampSettings(_three(T[:3, 3]), float(light.get("intensity", 1.0)), colour, facing))
    found.sort(key=lambda lamp: -lamp.power)
    said = [f"{suns} lights without a place (suns) are left out"] if suns else []
    if len(found) > MOST_LAMPS:
        said.append(f"the brightest {MOST_LAMPS} of {len(found)} lights are kept")
    return found[:MOST_LAMPS], said


def _three(values: Iterable[float]) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _light_of(graph: Any, node: str) -> int | None:
    parent = graph.transforms.parents.get(node)
    edge = graph.transforms.edge_data.get((parent, node), {})
    metadata = edge.get("metadata") or {}
    light = metadata.get("gltf_extensions", {}).get(LIGHTS, {}).get("light")
    return light if isinstance(light, int) else None
