"""Settings of the simulator, as its YAML file gives them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from facetcam.config import require_ranges
from facetcam.errors import ConfigError
from facetcam.simulation.scene import Lamp

Colour = tuple[float, float, float]
FLICKER = 12.0  # changes of level a second
LATEST = 1e6  # seconds, the end of any film


@dataclass(frozen=True, slots=True)
class CameraSettings:
    """The camera besides what the rig says.

    Parameters
    ----------
    samples : int
        Rays a pixel. Lens, exposure and the inside of the pixel are sampled together.
    blur : float
        Point spread: standard deviation of a Gaussian in pixels.
    aperture, focus : float
        Diameter of the entrance pupil, and metres from the lens, along the broken ray, that are sharp.
        0 is a pinhole.
    exposure_time, readout : float
        Seconds that the shutter is open, and from the first row to the last (rolling shutter).
    vignetting : float
        0 for none, 1 for the full fall of light with the fourth power of the cosine.
    exposure : float, optional
        Fixed factor on the light; automatic by default.
    lag : float
        Seconds after which automatic exposure has made up for 63 % of a change.
    noise : bool
    full_well, read_noise : float
        Electrons.
    stray : bool
        Follow rays that belong to no view, as in the real rig; otherwise those pixels are black.
    body : float
        Radius in metres of the camera, a black ball that mirrors may show; 0 for none.
    """

    samples: int = 2
    blur: float = 0.5
    aperture: float = 0.0
    focus: float = 2.0
    exposure_time: float = 0.0
    readout: float = 0.0
    vignetting: float = 0.0
    exposure: float | None = None
    lag: float = 0.6
    noise: bool = True
    full_well: float = 9000.0
    read_noise: float = 8.0
    stray: bool = True
    body: float = 0.0

    def __post_init__(self) -> None:
        require_ranges(
            "camera",
            self,
            samples=(1, 256),
            blur=(0.0, 50.0),
            aperture=(0.0, 0.1),
            focus=(1e-3, 1e6),
            exposure_time=(0.0, 10.0),
            readout=(0.0, 10.0),
            vignetting=(0.0, 1.0),
            exposure=(1e-6, 1e6),
            lag=(1e-3, 1e3),
            full_well=(10.0, 1e7),
            read_noise=(0.0, 1e4),
            body=(0.0, 1.0),
        )


@dataclass(frozen=True, slots=True)
class Switch:
    """What a lamp does from a time in seconds on: `on`, `off`, `dim` to a level, or `flicker` below it."""

    at: float
    do: Literal["on", "off", "dim", "flicker", True, False]  # YAML reads a bare on and off as booleans
    level: float | None = None
    over: float = 0.1

    def __post_init__(self) -> None:
        if isinstance(self.do, bool):
            object.__setattr__(self, "do", "on" if self.do else "off")
        require_ranges("lamp: schedule", self, at=(-1e3, LATEST), level=(0.0, 1e3), over=(0.0, LATEST))


@dataclass(frozen=True, slots=True)
class LampSettings:
    """A ball of light, or with `facing` a window; see `facetcam.simulation.scene.Lamp`."""

    position: Colour
    power: float = 1.5
    colour: Colour = (1.0, 0.94, 0.84)
    facing: Colour | None = None
    schedule: tuple[Switch, ...] = ()

    def lamp(self, seed: int, until: float) -> Lamp:
        """Make the lamp with its schedule up to a time in seconds."""
        facing = self.facing
        if facing is not None:
            length = float(np.linalg.norm(facing))
            if length == 0.0:
                raise ConfigError("lamp: facing must not be zero")
            facing = (facing[0] / length, facing[1] / length, facing[2] / length)
        require_ranges("lamp", self, power=(0.0, 1e6), colour=(0.0, 1e3), position=(-1e6, 1e6))
        return Lamp(self.position, self.power, self.colour, facing, _levels(self.schedule, seed, until))


@dataclass(frozen=True, slots=True)
class LightSettings:
    """Lamps, the light from everywhere, and the sky.

    Without lamps, some are hung above the path.
    """

    lamps: tuple[LampSettings, ...] | None = None
    ambient: Colour = (0.25, 0.25, 0.25)
    sky: Colour = (0.35, 0.4, 0.5)

    def __post_init__(self) -> None:
        require_ranges("light", self, ambient=(0.0, 1e6), sky=(0.0, 1e6))


@dataclass(frozen=True, slots=True)
class BuildSettings:
    """Standard deviations of what goes wrong when the rig is built from the drawing.

    Parameters
    ----------
    tilt_degrees, shift_mm : float
        Of each mirror: turn about each axis through its middle, and move along each axis.
    camera_degrees, camera_mm : float
        Of the camera.
    focal_percent, centre_pixels : float
        Of the lens.
    """

    tilt_degrees: float = 0.0
    shift_mm: float = 0.0
    camera_degrees: float = 0.0
    camera_mm: float = 0.0
    focal_percent: float = 0.0
    centre_pixels: float = 0.0

    def __post_init__(self) -> None:
        angles = {"tilt_degrees": (0.0, 45.0), "camera_degrees": (0.0, 45.0)}
        lengths = {"shift_mm": (0.0, 1e3), "camera_mm": (0.0, 1e3)}
        require_ranges(
            "build", self, **angles, **lengths, focal_percent=(0.0, 30.0), centre_pixels=(0.0, 1e4)
        )


@dataclass(frozen=True, slots=True)
class SimulationConfig:
    """Everything that `facetcam simulate --settings` reads."""

    camera: CameraSettings = field(default_factory=CameraSettings)
    light: LightSettings = field(default_factory=LightSettings)
    build: BuildSettings = field(default_factory=BuildSettings)


def _levels(switches: tuple[Switch, ...], seed: int, until: float) -> tuple[tuple[float, float], ...]:
    """Brightness over time as corners of a polyline."""
    times = [switch.at for switch in switches]
    if times != sorted(times):
        raise ConfigError("lamp: the times of a schedule must grow")
    rng = np.random.default_rng(seed)
    points, level = [(-1e9, 1.0)], 1.0
    for index, switch in enumerate(switches):
        end = times[index + 1] if index + 1 < len(times) else max(until, switch.at)
        wanted = {"on": 1.0, "off": 0.0, "dim": 0.4, "flicker": 1.0}[str(switch.do)]
        wanted = wanted if switch.level is None else switch.level
        start = max(switch.at, points[-1][0] + 1e-6)
        points.append((start, level))
        if switch.do == "flicker":
            count = int((end - start) * FLICKER)
            moments = start + 1.0 / FLICKER + np.arange(count) / FLICKER
            points += [(float(t), float(wanted * rng.uniform(0.1, 1.0))) for t in moments if t < end]
            level = points[-1][1]
        else:
            level = wanted
            points.append((start + max(switch.over, 1e-6), level))
    return tuple(points)
