"""The film that the rig's camera takes on a drive."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from facetcam.rig import Rig
from facetcam.simulation.drive import Drive
from facetcam.simulation.rays import FrameRays
from facetcam.simulation.renderer import Renderer
from facetcam.simulation.sensor import AutoExposure, Sensor


@dataclass(eq=False)
class Film:
    """Frames of a drive, rendered when asked for; every pass gives the same frames.

    Parameters
    ----------
    rig : Rig
    renderer : Renderer
    drive : Drive
    seed : int
        Of the sensor's noise.
    """

    rig: Rig
    renderer: Renderer
    drive: Drive
    seed: int = 0
    sensor: Sensor = field(default_factory=Sensor)

    def __post_init__(self) -> None:
        self.rays = FrameRays(self.rig)

    def __len__(self) -> int:
        return len(self.drive)

    def __iter__(self) -> Iterator[NDArray[np.uint8]]:
        """Yield raw frames (H, W, 3) BGR; the exposure follows the light as it goes."""
        exposure = AutoExposure()
        for index, (time, pose) in enumerate(zip(self.drive.times, self.drive.poses)):
            radiance, _ = self.rays.render(self.renderer, pose, float(time))
            noise = np.random.default_rng([self.seed, index])
            yield self.sensor.develop(radiance, exposure.follow(radiance, float(time)), noise)

    def exposure(self, index: int, time: float) -> float:
        """Right exposure at the place of frame `index` in the light of a time in seconds."""
        radiance, _ = self.rays.render(self.renderer, self.drive.poses[index], time)
        return AutoExposure().follow(radiance, time)

    def still(self, index: int, time: float, exposure: float) -> NDArray[np.uint8]:
        """Take a raw frame at the place of frame `index` in the light of another time in seconds."""
        radiance, _ = self.rays.render(self.renderer, self.drive.poses[index], time)
        noise = np.random.default_rng([self.seed, index, round(1e3 * time)])
        return self.sensor.develop(radiance, exposure, noise)
