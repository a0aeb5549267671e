"""Pictures, colours, opacity and glow of meshes as trimesh reads them."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from facetcam.simulation.materials import Picture
from facetcam.simulation.meshes import Material

GREY = (200, 200, 200)
WHITE = np.full((1, 1, 3), 255, dtype=np.uint8)


def material_of(visual: Any, cache: dict[object, Any]) -> Material:
    """The material of a trimesh visual; each one and its picture are made once."""
    source = getattr(visual, "material", None)
    if getattr(visual, "kind", None) == "vertex":
        return Material(WHITE)  # the tints of its corners say the rest
    if source is None:  # colours of faces
        colour = np.asarray(getattr(visual, "main_color", (*GREY, 255)))[:3]
        return Material(np.full((1, 1, 3), colour, dtype=np.uint8))
    if id(source) not in cache:
        material = _painted(source)
        # Copies of a piece of furniture bring copies of its picture.
        key = hashlib.sha256(material.picture.tobytes()).digest(), material.picture.shape
        cache[id(source)] = replace(material, picture=cache.setdefault(key, material.picture))
    made: Material = cache[id(source)]
    return made


def tints_of(visual: Any, linear: bool) -> NDArray[np.uint8] | None:
    """Colours (V, 3) of corners as square roots of linear shares; None for white. glTF states them linear."""
    if getattr(visual, "kind", None) == "vertex":
        colours = np.asarray(visual.vertex_colors)[:, :3]
    else:
        colours = np.asarray((getattr(visual, "vertex_attributes", None) or {}).get("color", ()))
        if colours.ndim != 2:
            return None
    shares = colours[:, :3].astype(np.float64)
    if np.issubdtype(colours.dtype, np.integer):
        shares = shares / np.iinfo(colours.dtype).max
    shares = np.nan_to_num(shares).clip(0.0, 1.0)
    return np.rint(255 * (np.sqrt(shares) if linear else shares)).astype(np.uint8)


def _painted(source: Any) -> Material:
    image = getattr(source, "baseColorTexture", None)
    image = getattr(source, "image", None) if image is None else image
    factor = getattr(source, "baseColorFactor", None)
    factor = getattr(source, "diffuse", None) if factor is None and image is None else factor
    colour = np.ones(4) if factor is None else _unit(factor)
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
    return Material(picture, (r, g, b), opacity if clear else None, cutoff, *_glow(source))


def _glow(source: Any) -> tuple[float, Picture | None]:
    """Strength of a material's own light, and its picture; by glTF it does not depend on what reflects."""
    factor = getattr(source, "emissiveFactor", None)
    shares = np.zeros(3) if factor is None else _unit(factor)[:3].clip(0.0, 1.0)
    strength = float(shares.max())
    if strength == 0.0:
        return 0.0, None
    image = getattr(source, "emissiveTexture", None)
    picture = WHITE if image is None else np.asarray(image.convert("RGB"))
    return strength, np.rint(picture * np.sqrt(shares / strength)).astype(np.uint8)


def _unit(colour: Any) -> NDArray[np.float64]:
    """A colour of bytes or shares as shares, with opacity."""
    values = np.asarray(colour)
    shares = values / 255.0 if values.dtype == np.uint8 or values.max() > 1 else values.astype(np.float64)
    return np.append(shares, np.ones(4))[:4] if len(shares) < 4 else shares[:4]
