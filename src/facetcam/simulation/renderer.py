"""What rays see in a scene: nearest surface, mip-mapped picture, baked light.

`Renderer` is the seam to other ray tracers: the rest needs nothing but `trace`, `lighting` and `shade`.
"""

from __future__ import annotations

import os

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from facetcam import _core
from facetcam.simulation.light import bake
from facetcam.simulation.materials import Picture
from facetcam.simulation.scene import Scene

Array32 = NDArray[np.float32]


# Where rays end: index of the surface (-1 for none), metres (inf for none), place on the picture from 0 to 1.
HIT = np.dtype([("surface", np.int32), ("distance", np.float32), ("u", np.float32), ("v", np.float32)])
Hits = NDArray[np.void]


class Renderer:
    """Renders one scene.

    Parameters
    ----------
    scene : Scene
    threads : int, optional
        All processors by default; the result does not depend on it.
    """

    def __init__(self, scene: Scene, threads: int | None = None) -> None:
        self.scene = scene
        self.threads = threads or os.cpu_count() or 1
        self._rectangles = np.array(
            [
                np.concatenate([s.corner, s.right / s.size[0], s.down / s.size[1], s.size])
                for s in scene.surfaces
            ],
            dtype=np.float32,
        )
        self._tree = _core.RectangleTree(self._rectangles)
        self._texels, self._textures = pack_mipmaps([s.picture for s in scene.surfaces])
        self._light_maps = bake(scene, self.trace)

    def trace(self, origins: ArrayLike, directions: ArrayLike) -> Hits:
        """Find the nearest surface that faces each ray.

        Parameters
        ----------
        origins : (3,) or (N, 3) array
            One for all rays, or one each; world frame, metres.
        directions : (N, 3) array
            Unit vectors.

        Returns
        -------
        (N,) array of HIT
        """
        origins = np.ascontiguousarray(np.reshape(origins, (-1, 3)), dtype=np.float32)
        directions = np.ascontiguousarray(directions, dtype=np.float32)
        return self._tree.cast(origins, directions, self.threads).view(HIT).ravel()

    def lighting(self, time: float = 0.0) -> Array32:
        """State of the lamps at a time in seconds, as `shade` takes it."""
        return self._light_maps.at(time)

    def shade(self, hits: Hits, directions: Array32, ray_angle: float, lighting: Array32) -> Array32:
        """Light that comes back along traced rays.

        Parameters
        ----------
        hits : (N,) array of HIT
            From `trace`.
        directions : (N, 3) float32 array
            The same unit vectors.
        ray_angle : float
            Angle between neighbouring rays in radians, for the choice of the texture's resolution.
        lighting : array
            From `lighting`.

        Returns
        -------
        (N, 3) float32 array
            Red, green, blue, linear; 1 is a white surface in unit irradiance. Zero where a ray meets nothing.
        """
        return _core.shade_rays(
            self._rectangles,
            self._texels,
            self._textures,
            lighting,
            self._light_maps.layout,
            directions,
            hits.view(np.uint8).reshape(-1, HIT.itemsize),
            ray_angle,
            self.threads,
        )


def pack_mipmaps(pictures: list[Picture]) -> tuple[Picture, NDArray[np.int32]]:
    """Lay pictures and their halved copies into one table of texels.

    Returns
    -------
    texels : (T, 3) uint8 array
        Square roots of linear reflectance, close to sRGB.
    layout : (N, 4) int32 array
        Offset, width, height and number of levels of each picture.
    """
    texels, layout, offset = [], [], 0
    for picture in pictures:
        levels = _mipmap(picture)
        layout.append((offset, picture.shape[1], picture.shape[0], len(levels)))
        texels += [level.reshape(-1, 3) for level in levels]
        offset += sum(level.shape[0] * level.shape[1] for level in levels)
    return np.concatenate(texels), np.array(layout, dtype=np.int32)


def _mipmap(picture: Picture) -> list[Picture]:
    levels = [picture]
    linear = np.square(picture.astype(np.float32))
    while min(linear.shape[:2]) > 1:
        size = linear.shape[1] // 2, linear.shape[0] // 2
        linear = cv2.resize(linear, size, interpolation=cv2.INTER_AREA)
        levels.append(np.rint(np.sqrt(linear)).astype(np.uint8))
    return levels
