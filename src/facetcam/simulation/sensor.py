"""From light to a noisy 8-bit picture: exposure, shot and read noise, tone curve."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array32 = NDArray[np.float32]
Image = NDArray[np.uint8]

KEY = 0.26  # mean of the exposed light that automatic exposure aims at; 1 saturates


@dataclass(frozen=True, slots=True)
class Sensor:
    """A camera sensor.

    Parameters
    ----------
    full_well : float
        Electrons at saturation; their square root is the shot noise.
    read_noise : float
        Electrons, standard deviation.
    """

    full_well: float = 9000.0
    read_noise: float = 8.0

    def develop(self, radiance: Array32, exposure: float, rng: np.random.Generator | None = None) -> Image:
        """Turn radiance (H, W, 3) RGB into a picture (H, W, 3) uint8 BGR, without noise if `rng` is None."""
        light = radiance[..., ::-1] * np.float32(exposure)
        if rng is not None:
            variance = light / np.float32(self.full_well) + np.float32(
                (self.read_noise / self.full_well) ** 2
            )
            light = light + np.sqrt(variance) * rng.standard_normal(light.shape, dtype=np.float32)
        # The square root stands for the usual gamma of 2.2.
        return np.asarray(np.rint(255.0 * np.sqrt(np.clip(light, 0.0, 1.0))), dtype=np.uint8)


@dataclass(slots=True)
class AutoExposure:
    """Exposure that follows the light late.

    Parameters
    ----------
    lag : float
        Seconds after which 63 % of a change is made up for.
    """

    lag: float = 0.6
    exposure: float = 0.0
    _time: float = 0.0

    def follow(self, radiance: Array32, time: float) -> float:
        """Exposure of a frame at a time in seconds, from the lit pixels of its radiance (H, W, 3)."""
        metered = radiance[::4, ::4].reshape(-1, 3)
        lit = metered[metered.any(axis=1)]
        wanted = KEY / max(float(lit.mean()), 1e-3) if lit.size else 1.0
        if self.exposure == 0.0:
            self.exposure = wanted
        else:
            self.exposure *= (wanted / self.exposure) ** (1.0 - np.exp(-(time - self._time) / self.lag))
        self._time = time
        return self.exposure
