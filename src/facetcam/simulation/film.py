"""The film that the rig's camera takes on a drive."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from facetcam.rig import Rig
from facetcam.simulation.drive import Drive
from facetcam.simulation.exposures import Exposures
from facetcam.simulation.mesh_renderer import MeshRenderer
from facetcam.simulation.meshes import Material, joined, quad
from facetcam.simulation.scene import Scene
from facetcam.simulation.sensor import AutoExposure, Sensor
from facetcam.simulation.settings import CameraSettings

Array = NDArray[np.float64]
Array32 = NDArray[np.float32]


def renderer_of(scene: Scene, threads: int | None = None) -> MeshRenderer:
    """Make the renderer of a scene of rectangles with its lamps."""
    quads = [quad(s.corner, s.right, s.down, Material(s.picture, glow=s.glow)) for s in scene.surfaces]
    return MeshRenderer(joined(quads), scene.lamps, threads=threads)


@dataclass(eq=False)
class Film:
    """Frames of a drive, rendered when asked for; every pass gives the same frames.

    Parameters
    ----------
    rig : Rig
    renderer : MeshRenderer
    drive : Drive
    seed : int
        Of the sensor's noise.
    settings : CameraSettings
        Of its rays; the shutter is open for no time, and nothing moves meanwhile.
    """

    rig: Rig
    renderer: MeshRenderer
    drive: Drive
    seed: int = 0
    sensor: Sensor = field(default_factory=Sensor)
    settings: CameraSettings = field(default_factory=lambda: CameraSettings(samples=4))

    def __post_init__(self) -> None:
        self._exposures = Exposures(self.rig, self.renderer, self.settings)

    def __len__(self) -> int:
        return len(self.drive)

    def __iter__(self) -> Iterator[NDArray[np.uint8]]:
        """Yield raw frames (H, W, 3) BGR; the exposure follows the light as it goes."""
        exposure = AutoExposure()
        for index, time in enumerate(self.drive.times):
            radiance = self.radiance(index, float(time))
            noise = np.random.default_rng([self.seed, index])
            yield self.sensor.develop(radiance, exposure.follow(radiance, float(time)), noise)

    def radiance(self, index: int, time: float) -> Array32:
        """Light (H, W, 3) at the place of frame `index` at a time in seconds; red, green, blue, linear."""
        return self._exposures.radiance(lambda moment: self.drive.poses[index], time)

    def exposure(self, index: int, time: float) -> float:
        """Right exposure at the place of frame `index` in the light of a time in seconds."""
        return AutoExposure().follow(self.radiance(index, time), time)

    def still(self, index: int, time: float, exposure: float) -> NDArray[np.uint8]:
        """Take a raw frame at the place of frame `index` in the light of another time in seconds."""
        noise = np.random.default_rng([self.seed, index, round(1e3 * time)])
        return self.sensor.develop(self.radiance(index, time), exposure, noise)
