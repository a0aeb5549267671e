"""Rooms of glowing pictures for tests of the simulator; another renderer can be given the same ones."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam.rig import Rig
from facetcam.simulation.meshes import Material, Mesh, joined, quad

Array = NDArray[np.float64]
Quad = tuple[Array, Array, Array, NDArray[np.uint8]]

LOW, HIGH = np.array([-1.5, -1.3, -1.2]), np.array([1.7, 1.6, 1.4])
FIELDS = 16
TEXELS = 512


def checkered(rng: np.random.Generator) -> NDArray[np.uint8]:
    """A board of FIELDS x FIELDS with blotches of colour, RGB."""
    cell = TEXELS // FIELDS
    fields = (np.indices((FIELDS, FIELDS)).sum(axis=0) % 2).repeat(cell, 0).repeat(cell, 1)
    blotches = cv2.resize(rng.uniform(-20, 20, (12, 12, 3)), (TEXELS, TEXELS), interpolation=cv2.INTER_CUBIC)
    return np.clip(55 + 145 * fields[..., None] + blotches, 0, 255).astype(np.uint8)


def room_quads(seed: int = 0) -> list[Quad]:
    """Upper left corner, edges right and down, and picture of the six walls, seen from inside."""
    rng, quads = np.random.default_rng(seed), []
    size = HIGH - LOW
    for axis in range(3):
        for top in (False, True):
            one, other = np.roll(np.diag(size), -axis - 1, axis=0)[:2]
            corner = LOW + (np.diag(size)[axis] if top else 0.0)
            # From inside, right x (-down) points to the viewer.
            right, down = (one, other) if top else (other, one)
            quads.append((corner, right, down, checkered(rng)))
    return quads


def glowing(quads: list[Quad]) -> Mesh:
    """The mesh of quads that need no lamp: their light is the square of their picture."""
    return joined([quad(c, r, d, Material(picture, glow=1.0)) for c, r, d, picture in quads])


def resized(rig: Rig, factor: float) -> Rig:
    """The same rig with fewer pixels."""
    c = rig.camera
    camera = replace(
        c,
        width=round(c.width * factor),
        height=round(c.height * factor),
        fx=c.fx * factor,
        fy=c.fy * factor,
        cx=(c.cx + 0.5) * factor - 0.5,
        cy=(c.cy + 0.5) * factor - 0.5,
    )
    return replace(rig, camera=camera)
