"""The rays of a raw frame, through the mirrors; computed once a rig and moved with it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam.rig import Rig
from facetcam.simulation.renderer import Renderer

Array = NDArray[np.float64]
Array32 = NDArray[np.float32]

BLUR = 1.4  # pixels; lenses draw nothing finer, and textures sampled finer would flicker
_AROUND = np.ones((3, 3), dtype=np.uint8)


@dataclass(frozen=True, eq=False, slots=True)
class _View:
    """The part of the frame that one view fills.

    Attributes
    ----------
    T_rig_image : (4, 4) array
        Virtual camera of the raw image, mirrored for odd chains.
    pixels : (N,) array
        Places in the flattened frame.
    weight : (N, S) float32 array
        Share of the pixel's light that each of S samples brings: zero where it misses the view's mirrors.
    seam : (N,) bool array
        True where some samples miss.
    own : (N,) bool array
        True where the ray of the pixel's middle does not miss.
    """

    T_rig_image: Array
    pixels: NDArray[np.intp]
    weight: Array32
    seam: NDArray[np.bool_]
    own: NDArray[np.bool_]


class FrameRays:
    """All rays of a rig's raw frame.

    Parameters
    ----------
    rig : Rig
        A rig without mirrors is an ordinary camera.
    samples : int
        Rays along each side of a pixel that shows an edge; 2 gives four rays.
    """

    def __init__(self, rig: Rig, samples: int = 2) -> None:
        self.width, self.height = rig.size
        self._ray_angle = BLUR / max(rig.camera.fx, rig.camera.fy)
        pixels = np.stack(np.meshgrid(np.arange(self.width), np.arange(self.height)), axis=-1)
        rays = rig.camera.ray(pixels.reshape(-1, 2)).reshape(self.height, self.width, 3)
        self._rays = _flat(rays)
        # Within a pixel rays change linearly to better than 0.001 pixels.
        self._down, self._right = (_flat(np.asarray(np.gradient(rays, axis=axis))) for axis in (0, 1))
        offsets = (np.arange(samples) + 0.5) / samples - 0.5
        self._offsets = np.stack(np.meshgrid(offsets, offsets), axis=-1).reshape(-1, 2)
        labels = rig.labels()
        self._views = [_view(rig, name, labels == i, self._offsets) for i, name in enumerate(rig.view_names)]

    def render(self, renderer: Renderer, T_world_rig: Array, time: float = 0.0) -> tuple[Array32, Array32]:
        """Radiance and depth of a frame.

        Parameters
        ----------
        renderer : Renderer
        T_world_rig : (4, 4) array
        time : float
            Seconds, for the lamps.

        Returns
        -------
        radiance : (height, width, 3) float32 array
            Red, green, blue, linear; zero where no view sees the room.
        depth : (height, width) float32 array
            Metres from the view's virtual centre along the ray of the pixel's middle; inf for none.
        """
        radiance = np.zeros((self.height * self.width, 3), dtype=np.float32)
        depth = np.full(self.height * self.width, np.inf, dtype=np.float32)
        lighting = renderer.lighting(time)
        for view in self._views:
            light, distance = self._render_view(view, renderer, T_world_rig @ view.T_rig_image, lighting)
            radiance[view.pixels] += light
            depth[view.pixels[view.own]] = distance[view.own]
        return radiance.reshape(self.height, self.width, 3), depth.reshape(self.height, self.width)

    def _render_view(
        self, view: _View, renderer: Renderer, T_world_image: Array, lighting: Array32
    ) -> tuple[Array32, Array32]:
        """Light and distance (N, 3), (N,): one ray a pixel, all samples where a surface or a mirror ends."""
        origin, turn = T_world_image[:3, 3], T_world_image[:3, :3].T.astype(np.float32)
        centres = self._rays[view.pixels] @ turn
        hits = renderer.trace(origin, centres)
        light = renderer.shade(hits, centres, self._ray_angle, lighting)
        edges = np.flatnonzero(view.seam | self._outlines(view.pixels, hits["surface"]))
        directions = self._samples(view.pixels[edges]) @ turn
        weight = view.weight[edges]
        sample_angle = self._ray_angle / float(np.sqrt(weight.shape[1]))
        samples = renderer.shade(renderer.trace(origin, directions), directions, sample_angle, lighting)
        light[edges] = np.einsum("ps,psc->pc", weight, samples.reshape(*weight.shape, 3))
        return light, hits["distance"]

    def _samples(self, pixels: NDArray[np.intp]) -> Array32:
        """Unit directions (N * S, 3) of all samples of pixels (N,), camera frame."""
        x, y = self._offsets.astype(np.float32).T[..., None, None]
        rays = self._rays[pixels] + x * self._right[pixels] + y * self._down[pixels]
        rays = rays.swapaxes(0, 1).reshape(-1, 3)
        return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))

    def _outlines(self, pixels: NDArray[np.intp], surface: NDArray[np.int32]) -> NDArray[np.bool_]:
        """Tell which pixels (N,) have a neighbour that shows another surface."""
        frame = np.zeros((self.height, self.width), dtype=np.float32)
        frame.flat[pixels] = surface
        change = cv2.dilate(frame, _AROUND) != cv2.erode(frame, _AROUND)
        return np.asarray(change.ravel()[pixels])


def _flat(vectors: Array) -> Array32:
    return np.asarray(vectors.reshape(-1, 3), dtype=np.float32)


def _view(rig: Rig, name: str, area: NDArray[np.bool_], offsets: Array) -> _View:
    inner = cv2.erode(area.astype(np.uint8), _AROUND).ravel() > 0
    # Pixels beside the area may have part of their samples inside.
    pixels = np.flatnonzero(cv2.dilate(area.astype(np.uint8), _AROUND))
    sees = np.repeat(inner[pixels][:, None], len(offsets), axis=1)
    doubtful = pixels[~inner[pixels]]
    places = np.column_stack([doubtful % rig.camera.width, doubtful // rig.camera.width])[:, None] + offsets
    sees[~inner[pixels]] = rig.sees(name, places).reshape(len(doubtful), len(offsets))
    weight = np.asarray(sees / len(offsets), dtype=np.float32)
    seam = np.asarray(~sees.all(axis=1))
    return _View(rig.T_rig_image(name), pixels, weight, seam, own=area.ravel()[pixels])
