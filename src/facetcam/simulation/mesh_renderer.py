"""What rays see in a triangle mesh: nearest triangle, mip-mapped picture, opacity, baked light."""

from __future__ import annotations

import os
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from facetcam.simulation import embree
from facetcam.simulation.embree import EmbreeTree
from facetcam.simulation.mesh_light import bake_mesh, lattices
from facetcam.simulation.mesh_tables import shader_of, without_pictures
from facetcam.simulation.meshes import Mesh
from facetcam.simulation.scene import Lamp
from facetcam.simulation.triangle_tree import Hits, TriangleTree

Array32 = NDArray[np.float32]
Progress = Callable[[int, int | None], None]

LAYERS = 8  # clear surfaces that a ray passes at most
_STEP = 1e-4  # metres beyond a clear surface where its ray goes on


class MeshRenderer:
    """Renders one mesh.

    Parameters
    ----------
    mesh : Mesh
    lamps : tuple of Lamp
    ambient : tuple of float
        Red, green and blue irradiance from everywhere on an open place.
    sky : tuple of float
        Light of rays that leave the scene.
    threads : int, optional
        All processors by default; the result does not depend on it.
    progress : callable
        Of the light, in places.

    Raises
    ------
    FacetcamError
        If there is no room for the scene.

    Attributes
    ----------
    coarser : int
        How many pictures are coarser than they were, to keep memory small.
    """

    def __init__(
        self,
        mesh: Mesh,
        lamps: tuple[Lamp, ...] = (),
        ambient: tuple[float, float, float] = (0.0, 0.0, 0.0),
        sky: tuple[float, float, float] = (0.0, 0.0, 0.0),
        threads: int | None = None,
        progress: Progress = lambda done, total: None,
    ) -> None:
        self.threads = threads or len(os.sched_getaffinity(0))
        self.sky = np.array(sky, dtype=np.float32)
        tree = EmbreeTree if embree.installed() else TriangleTree
        self.tree = tree(mesh.vertices, mesh.faces, self.threads)
        places = lattices(mesh)
        self._shader, self.coarser = shader_of(mesh, places)
        self.mesh = without_pictures(mesh)
        self._light = bake_mesh(places, lamps, ambient, self.tree.trace, progress)
        self._clear = np.array([m.alpha is not None for m in mesh.materials])

    def lighting(self, time: float = 0.0) -> Array32:
        """State of the lamps at a time in seconds, as `look` takes it."""
        return self._light.at(time)

    def trace(self, origins: ArrayLike, directions: ArrayLike, threads: int | None = None) -> Hits:
        """Nearest triangle along rays; see `TriangleTree.trace`."""
        return self.tree.trace(origins, directions, threads)

    def look(
        self,
        origins: Array32,
        directions: Array32,
        travelled: Array32,
        ray_angle: float,
        lighting: Array32,
        limits: Array32 | None = None,
        threads: int | None = None,
    ) -> tuple[Array32, Array32]:
        """Light that comes back along rays, through what is clear.

        Parameters
        ----------
        origins, directions : (N, 3) float32 arrays
            Metres; unit vectors.
        travelled : (N,) float32 array
            Metres of the ray before its origin, for the choice of the texture's resolution.
        ray_angle : float
            Angle between neighbouring rays in radians.
        lighting : array
            From `lighting`.
        limits : (N,) float32 array, optional
            Metres from the origin beyond which a ray sees nothing, not even the sky.
        threads : int, optional

        Returns
        -------
        radiance : (N, 3) float32 array
            Red, green, blue, linear; 1 is a white surface in unit irradiance.
        distance : (N,) float32 array
            From the origin to the first thing that is not wholly clear; inf for none.
        """
        threads = threads or self.threads
        hits = self.trace(origins, directions, threads)
        if limits is not None:
            hits["surface"][hits["distance"] >= limits] = -1
        radiance = self._shader.shade(
            lighting,
            directions,
            travelled,
            hits.view(np.uint8).reshape(-1, hits.itemsize),
            ray_angle,
            threads,
        )
        missed = hits["surface"] < 0
        distance = np.where(missed, np.float32(np.inf), hits["distance"])
        if limits is None:
            radiance[missed] = self.sky
        if self._clear.any():
            self._see_through(
                origins, directions, travelled, ray_angle, lighting, limits, hits, radiance, distance
            )
        return radiance, distance

    def _see_through(
        self,
        origins: Array32,
        directions: Array32,
        travelled: Array32,
        ray_angle: float,
        lighting: Array32,
        limits: Array32 | None,
        hits: Hits,
        radiance: Array32,
        distance: Array32,
    ) -> None:
        """Add what lies behind clear surfaces to radiance and distance, in place."""
        index = np.flatnonzero(hits["surface"] >= 0)
        index = index[self._clear[self.mesh.material[hits["surface"][index]]]]
        place, share = hits[index], np.ones(len(index), dtype=np.float32)
        way = place["distance"].copy()
        radiance[index] *= self._opacity(place)[:, None]
        share -= self._opacity(place)
        for _ in range(LAYERS):
            through = share > 1.0 / 512.0
            index, share, way = index[through], share[through], way[through] + np.float32(_STEP)
            if not len(index):
                return
            distance[index[share > 0.99]] = np.inf
            start = origins[index] + way[:, None] * directions[index]
            place = self.trace(start, directions[index], 1)
            way = way + place["distance"]
            beyond = np.zeros(len(index), bool) if limits is None else way >= limits[index]
            place["surface"][beyond] = -1
            light = self._shader.shade(
                lighting,
                directions[index],
                travelled[index] + way - place["distance"],
                place.view(np.uint8).reshape(-1, place.itemsize),
                ray_angle,
                1,
            )
            missed = place["surface"] < 0
            if limits is None:
                light[missed] = self.sky
            opacity = np.where(missed, 1.0, self._opacity(place)).astype(np.float32)
            radiance[index] += (share * opacity)[:, None] * light
            first = (opacity > 0.01) & ~np.isfinite(distance[index]) & ~missed
            distance[index[first]] = way[first]
            share = share * (np.float32(1.0) - opacity)

    def _opacity(self, hits: Hits) -> Array32:
        """Opacity (N,) of hit places."""
        opacity = np.ones(len(hits), dtype=np.float32)
        met = np.flatnonzero(hits["surface"] >= 0)
        kinds = self.mesh.material[hits["surface"][met]]
        for kind in np.unique(kinds[self._clear[kinds]]):
            some = met[kinds == kind]
            material = self.mesh.materials[kind]
            assert material.alpha is not None
            height, width = material.alpha.shape
            corners = self.mesh.uv[self.mesh.faces[hits["surface"][some]]]
            u, v = hits["u"][some, None], hits["v"][some, None]
            x, y = ((1 - u - v) * corners[:, 0] + u * corners[:, 1] + v * corners[:, 2]).T
            column = np.floor((x - np.floor(x)) * width).astype(int).clip(0, width - 1)
            row = np.floor((y - np.floor(y)) * height).astype(int).clip(0, height - 1)
            value = material.alpha[row, column] / np.float32(255.0)
            opacity[some] = value if material.cutoff is None else value >= material.cutoff
        return opacity
