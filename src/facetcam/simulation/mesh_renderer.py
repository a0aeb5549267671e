"""What rays see in a triangle mesh: nearest triangle, mip-mapped picture, opacity, baked light."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from facetcam import _core
from facetcam.simulation.embree import TriangleTree
from facetcam.simulation.mesh_light import Lattices, bake_mesh, lattices
from facetcam.simulation.meshes import Mesh, within_memory
from facetcam.simulation.renderer import Hits, pack_mipmaps
from facetcam.simulation.scene import Lamp

Array32 = NDArray[np.float32]
Progress = Callable[[int, int | None], None]

LAYERS = 8  # clear surfaces that a ray passes at most
_STEP = 1e-4  # metres beyond a clear surface where its ray goes on
_NO_PICTURE = np.zeros((1, 1, 3), dtype=np.uint8)
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
_NO_TINTS = np.zeros((0, 3), dtype=np.uint8)


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
        If Embree is not installed or has no room for the scene.
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
        self.tree = TriangleTree(mesh.vertices, mesh.faces, self.threads)
        places = lattices(mesh)
        self.coarser = self._prepare(mesh, places)
        self._light = bake_mesh(places, lamps, ambient, self.tree.trace, progress)
        self._clear = np.array([m.alpha is not None for m in mesh.materials])

    def _prepare(self, mesh: Mesh, places: Lattices) -> int:
        """Make the tables of the core; returns how many pictures had to be made coarser."""
        # Pictures live on in the table of texels only.
        bare = tuple(replace(m, picture=_NO_PICTURE, glow_picture=None) for m in mesh.materials)
        self.mesh = replace(mesh, materials=bare)
        distinct = {id(picture): picture for m in mesh.materials for picture in m.pictures}
        pictures, coarser = within_memory(list(distinct.values()))
        texels, layout = pack_mipmaps(pictures)
        order = {key: index for index, key in enumerate(distinct)}
        materials = np.zeros(len(mesh.materials), dtype=_MATERIAL)
        for column, field in enumerate(("texture", "glow_texture")):
            materials[field] = layout[[order[id(m.pictures[column])] for m in mesh.materials]]
        materials["colour"] = [m.colour for m in mesh.materials]
        materials["glow"] = [m.glow for m in mesh.materials]
        triangles = np.zeros(len(mesh.faces), dtype=_TRIANGLE)
        triangles["corner"], triangles["material"] = mesh.faces, mesh.material
        triangles["lattice"], triangles["steps"] = places.first, places.steps
        triangles["normal"], area = _normals(mesh)
        size = materials["texture"][mesh.material, 1:3].astype(np.float64)
        triangles["density"] = np.sqrt(_uv_area(mesh) * size.prod(axis=1) / area)
        self._shader = _core.TriangleShader(
            triangles.view(np.uint8).reshape(-1, _TRIANGLE.itemsize),
            np.ascontiguousarray(mesh.uv, dtype=np.float32),
            materials.view(np.uint8).reshape(-1, _MATERIAL.itemsize),
            texels,
            _NO_TINTS if mesh.tints is None else mesh.tints,
            len(places.place),
        )
        return coarser

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
