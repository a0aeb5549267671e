"""One exposed frame: all rays of a camera that may move while its shutter is open."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam.rig import Rig
from facetcam.simulation.mesh_renderer import MeshRenderer
from facetcam.simulation.paths import Hops, RigPaths
from facetcam.simulation.settings import CameraSettings

Array = NDArray[np.float64]
Array32 = NDArray[np.float32]

ROWS = 48  # traced at once
CACHE = 450_000_000  # bytes of rays kept from frame to frame
FOOTPRINT = 1.0  # pixels that a ray stands for, divided by the root of the samples

PoseAt = Callable[[float], Array]
"""T_world_rig at a time in seconds."""


@dataclass(frozen=True, eq=False, slots=True)
class Sampling:
    """Where in the pixel, the aperture and the exposure each of S samples lies; every mean is zero.

    Attributes
    ----------
    pixel : (S, 2) array
        Pixels.
    lens : (S, 2) array
        Metres.
    time : (S,) array
        Seconds.
    """

    pixel: Array
    lens: Array
    time: Array

    @classmethod
    def spread(cls, settings: CameraSettings, seed: int = 0) -> Sampling:
        """Spread samples evenly."""
        count, rng = settings.samples, np.random.default_rng(seed)
        step = np.arange(count)
        # Roberts' sequence fills the square evenly for any count.
        pixel = (0.5 + np.outer(step, (0.7548776662466927, 0.5698402909980532))) % 1.0 - 0.5
        radius = settings.aperture / 2 * np.sqrt((step + 0.5) / count)
        angle = step * np.pi * (3.0 - 5.0**0.5)
        lens = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
        time = ((step + 0.5) / count - 0.5) * settings.exposure_time
        return cls(
            pixel - pixel.mean(axis=0), rng.permutation(lens - lens.mean(axis=0)), rng.permutation(time)
        )


class Exposures:
    """Frames of one rig in one scene.

    Parameters
    ----------
    rig : Rig
    renderer : MeshRenderer
    settings : CameraSettings
    """

    def __init__(self, rig: Rig, renderer: MeshRenderer, settings: CameraSettings) -> None:
        self.rig, self.renderer, self.settings = rig, renderer, settings
        self.width, self.height = rig.size
        self._paths = RigPaths(rig, settings.body, settings.stray)
        self._sampling = Sampling.spread(settings)
        angle = FOOTPRINT / max(rig.camera.fx, rig.camera.fy)
        self._ray_angle = float(angle / np.sqrt(settings.samples))
        self._kept: dict[tuple[int, int, bool], list[Hops]] = {}
        self._kept_bytes = 0
        self._vignetting = self._fall_of_light()
        corners = renderer.mesh.vertices[renderer.mesh.faces]
        self._lows, self._highs = corners.min(axis=1), corners.max(axis=1)

    def radiance(self, pose_at: PoseAt, time: float) -> Array32:
        """Light (height, width, 3) that meets the sensor on average over the exposure; red, green, blue.

        Parameters
        ----------
        pose_at : callable
            T_world_rig at a time.
        time : float
            Seconds; the middle of the exposure of the middle row.
        """
        lighting = self.renderer.lighting(time)
        only_last = self._alone(pose_at(time))
        frame = np.zeros((self.height, self.width, 3), dtype=np.float32)

        def expose(top: int) -> None:
            band = frame[top : top + ROWS].reshape(-1, 3)
            for sample in range(self.settings.samples):
                start = self._pose(pose_at, time, top, sample)
                end = self._pose(pose_at, time, top + ROWS, sample)
                hops = self._hops(top, sample, only_last)
                band += self._look(hops, start, end, len(band), lighting)[0]

        # Bands do not share pixels, so their order does not matter.
        with ThreadPoolExecutor(self.renderer.threads) as pool:
            list(pool.map(expose, range(0, self.height, ROWS)))
        frame *= self._vignetting[..., None] / np.float32(self.settings.samples)
        if self.settings.blur > 0.0:
            # What lies beyond the border is not known; it is taken for what lies at the border.
            frame = cv2.GaussianBlur(frame, (0, 0), self.settings.blur, borderType=cv2.BORDER_REPLICATE)
        return np.asarray(frame, dtype=np.float32)

    def depth(self, pose: Array) -> Array32:
        """Metres (height, width) along the broken ray from the lens to the room; inf for none."""
        only_last, depth = self._alone(pose), np.empty(self.height * self.width, dtype=np.float32)
        lighting = self.renderer.lighting()
        for top in range(0, self.height, ROWS):
            pixels = self._pixels(top)
            hops = self._paths.hops(pixels, np.zeros(2), self.settings.focus, only_last)
            seen = self._look(hops, pose, pose, len(pixels), lighting)[1]
            depth[top * self.width : top * self.width + len(pixels)] = seen
        return depth.reshape(self.height, self.width)

    def _look(
        self, hops: list[Hops], start: Array, end: Array, rays: int, lighting: Array32
    ) -> tuple[Array32, Array32]:
        """Radiance (N, 3) and distance (N,) of a band whose pose goes from `start` to `end`."""
        radiance = np.zeros((rays, 3), dtype=np.float32)
        distance = np.full(rays, np.inf, dtype=np.float32)
        for hop in hops:
            waiting = ~np.isfinite(distance[hop.ray]) if hop is not hops[0] else slice(None)
            ray = hop.ray[waiting]
            row = (ray // self.width).astype(np.float32) / np.float32(ROWS)
            directions = _turned(hop.direction[waiting], start, end, row)
            origins = _turned(hop.start[waiting], start, end, row) + _moved(start, end, row)
            limit, travelled = hop.limit[waiting], hop.travelled[waiting]
            last = bool(np.isinf(limit).all())
            light, seen = self.renderer.look(
                origins, directions, travelled, self._ray_angle, lighting, None if last else limit, threads=1
            )
            if not last:
                gone = np.isinf(limit) & np.isinf(seen)
                light[gone] = self.renderer.sky
            radiance[ray] += light
            distance[ray] = travelled + seen
        return radiance, distance

    def _pose(self, pose_at: PoseAt, time: float, row: int, sample: int) -> Array:
        late = (row - (self.height - 1) / 2) / max(self.height - 1, 1) * self.settings.readout
        return pose_at(time + late + float(self._sampling.time[sample]))

    def _hops(self, top: int, sample: int, only_last: bool) -> list[Hops]:
        key = (top, sample, only_last)
        if key in self._kept:
            return self._kept[key]
        pixels = self._pixels(top) + self._sampling.pixel[sample]
        hops = self._paths.hops(pixels, self._sampling.lens[sample], self.settings.focus, only_last)
        size = sum(40 * len(hop.ray) for hop in hops)
        if self._kept_bytes + size <= CACHE:
            self._kept_bytes += size
            self._kept[key] = hops
        return hops

    def _pixels(self, top: int) -> Array:
        v, u = np.mgrid[top : min(top + ROWS, self.height), 0 : self.width]
        return np.column_stack([u.ravel(), v.ravel()]).astype(np.float64)

    def _alone(self, pose: Array) -> bool:
        """Tell that nothing of the scene reaches between the mirrors, to spare the rays there."""
        if not self._paths.bounded:
            return False
        centre = (pose @ self.rig.T_rig_cam)[:3, 3].astype(np.float32)
        away = np.maximum(self._lows - centre, 0.0) + np.maximum(centre - self._highs, 0.0)
        return bool((np.einsum("ij,ij->i", away, away) > (2.0 * self._paths.radius) ** 2).all())

    def _fall_of_light(self) -> Array32:
        if self.settings.vignetting == 0.0:
            return np.ones((self.height, self.width), dtype=np.float32)
        v, u = np.mgrid[0 : self.height, 0 : self.width]
        cosine = self.rig.camera.ray(np.column_stack([u.ravel(), v.ravel()]))[:, 2]
        fall = np.maximum(cosine, 0.0) ** (4.0 * self.settings.vignetting)
        return fall.reshape(self.height, self.width).astype(np.float32)


def _turned(vectors: Array32, start: Array, end: Array, share: Array32) -> Array32:
    """Vectors (N, 3) turned by a rotation that goes from one pose to the next; over a band it is minute."""
    turned = vectors @ start[:3, :3].T.astype(np.float32)
    if start is not end and not np.array_equal(start, end):
        turned += share[:, None] * (vectors @ (end - start)[:3, :3].T.astype(np.float32))
    return np.asarray(turned)


def _moved(start: Array, end: Array, share: Array32) -> Array32:
    move = (end - start)[:3, 3].astype(np.float32)
    if not move.any():
        return start[:3, 3].astype(np.float32)
    return np.asarray(start[:3, 3].astype(np.float32) + share[:, None] * move)
