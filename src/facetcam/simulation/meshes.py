"""Scenes made of textured triangles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam.errors import FacetcamError
from facetcam.simulation.materials import Picture

Array = NDArray[np.float64]
Array32 = NDArray[np.float32]

MOST_TRIANGLES = 5_000_000  # about 2 GB with tree, light and pictures
MOST_TEXELS = 160_000_000


@dataclass(frozen=True, eq=False)
class Material:
    """How triangles look.

    Parameters
    ----------
    picture : (H, W, 3) uint8 array
        RGB; repeats beyond its border.
    colour : tuple of float
        Factors of the picture's linear red, green and blue.
    alpha : (H, W) uint8 array, optional
        Opacity; None for opaque.
    cutoff : float, optional
        Below this opacity nothing is seen and above it all; None mixes by the opacity.
    glow : float
        Light that it sends out by itself, in units of irradiance.
    glow_picture : (H, W, 3) uint8 array, optional
        Where and in which colour it glows; `picture` by default.
    """

    picture: Picture
    colour: tuple[float, float, float] = (1.0, 1.0, 1.0)
    alpha: NDArray[np.uint8] | None = None
    cutoff: float | None = None
    glow: float = 0.0
    glow_picture: Picture | None = None

    @property
    def pictures(self) -> tuple[Picture, Picture]:
        """What reflects, and what glows."""
        return self.picture, self.picture if self.glow_picture is None else self.glow_picture


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles of several materials; both sides are seen.

    Attributes
    ----------
    vertices : (V, 3) float32 array
        Metres, z up.
    faces : (T, 3) int32 array
    normals : (V, 3) float32 array
        For the light; they point away from the side on which a face's corners turn to the left.
    uv : (V, 2) float32 array
        Places on the picture, 0 to 1 from its upper left corner to the right and down.
    material : (T,) int32 array
        Index into `materials`.
    materials : tuple of Material
    tints : (V, 3) uint8 array, optional
        Colours that pictures are multiplied with, as square roots of linear shares; None for white.
    """

    vertices: Array32
    faces: NDArray[np.int32]
    normals: Array32
    uv: Array32
    material: NDArray[np.int32]
    materials: tuple[Material, ...]
    tints: NDArray[np.uint8] | None = None

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Least and greatest corner in metres."""
        corners = self.vertices[self.faces].reshape(-1, 3)
        return corners.min(axis=0).astype(np.float64), corners.max(axis=0).astype(np.float64)

    def scaled(self, factor: float) -> Mesh:
        """Return the mesh with all lengths multiplied."""
        return replace(self, vertices=self.vertices * np.float32(factor))

    def turned_up(self) -> Mesh:
        """Return a mesh whose y pointed up with its z up."""
        turn = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], dtype=np.float32)
        return replace(self, vertices=self.vertices @ turn.T, normals=self.normals @ turn.T)


def joined(meshes: Sequence[Mesh]) -> Mesh:
    """Make one mesh of several.

    Raises
    ------
    FacetcamError
        If there are more triangles than memory is meant for.
    """
    triangles = sum(len(mesh.faces) for mesh in meshes)
    if not 0 < triangles <= MOST_TRIANGLES:
        raise FacetcamError(f"scene: {triangles} triangles; simplify it to between 1 and {MOST_TRIANGLES}")
    corners = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    kinds = np.cumsum([0, *(len(mesh.materials) for mesh in meshes)])
    return Mesh(
        np.concatenate([m.vertices for m in meshes]).astype(np.float32),
        np.concatenate([m.faces + first for m, first in zip(meshes, corners)]).astype(np.int32),
        np.concatenate([m.normals for m in meshes]).astype(np.float32),
        np.concatenate([m.uv for m in meshes]).astype(np.float32),
        np.concatenate([m.material + first for m, first in zip(meshes, kinds)]).astype(np.int32),
        tuple(material for m in meshes for material in m.materials),
        _joined_tints(meshes),
    )


def _joined_tints(meshes: Sequence[Mesh]) -> NDArray[np.uint8] | None:
    if all(mesh.tints is None for mesh in meshes):
        return None
    white = np.full(3, 255, dtype=np.uint8)
    return np.concatenate(
        [np.broadcast_to(white, m.vertices.shape) if m.tints is None else m.tints for m in meshes]
    )


def quad(corner: Array, right: Array, down: Array, material: Material) -> Mesh:
    """Make a rectangle with a picture, from its upper left corner and its edges right and down in metres."""
    corner, right, down = (np.asarray(v, dtype=np.float64) for v in (corner, right, down))
    vertices = np.array([corner, corner + right, corner + right + down, corner + down], dtype=np.float32)
    normal = np.cross(down, right)
    return Mesh(
        vertices,
        np.array([[0, 2, 1], [0, 3, 2]], dtype=np.int32),
        np.tile(normal / np.linalg.norm(normal), (4, 1)).astype(np.float32),
        np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float32),
        np.zeros(2, dtype=np.int32),
        (material,),
    )


def within_memory(pictures: Sequence[Picture], most: int = MOST_TEXELS) -> tuple[list[Picture], int]:
    """Halve the largest pictures until all of them together have at most `most` texels.

    Returns
    -------
    pictures : list of (H, W, 3) arrays
    halved : int
        How many are coarser than they were.
    """
    made, coarser = list(pictures), set()
    sizes = np.array([p.shape[0] * p.shape[1] for p in made], dtype=np.int64)
    while sizes.sum() > most and sizes.max() > 1:
        index = int(sizes.argmax())
        height, width = made[index].shape[:2]
        size = max(1, width // 2), max(1, height // 2)
        made[index] = np.asarray(cv2.resize(made[index], size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
        sizes[index] = size[0] * size[1]
        coarser.add(index)
    return made, len(coarser)
