"""Reading the inputs of a job and checking that they fit each other, before anything is written."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from facetcam.config import load_config
from facetcam.errors import SourceError
from facetcam.io.odometry import Odometry, read_odometry
from facetcam.io.sources import Source, open_source
from facetcam.io.trajectories import read_tum
from facetcam.pipelines.progress import total_frames
from facetcam.pipelines.slam_maps import NEW_MAP, MapChoice
from facetcam.rig import Rig
from facetcam.slam import SlamConfig
from facetcam.slam.odometry.check import CLOCK_RANGE

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class SlamInputs:
    """Checked inputs of a SLAM run."""

    source: Source
    rig_path: Path
    rig: Rig
    config: SlamConfig
    odometry: Odometry | None
    truth: tuple[Array, Array] | None
    maps: MapChoice = NEW_MAP
    odometry_offset: float = 0.0  # seconds by which the odometry's clock was found to be ahead

    def odometry_at(self, time: float) -> tuple[float, float, float] | None:
        """Odometry x, y, yaw at a frame's time, None where there is none."""
        return self.odometry.at(time) if self.odometry is not None else None

    def with_odometry_offset(self, seconds: float) -> SlamInputs:
        """The same inputs, with the odometry brought from its own clock to that of the film."""
        shifted = None if self.odometry is None else self.odometry.shifted(seconds)
        return replace(self, odometry=shifted, odometry_offset=seconds)


def read_slam_inputs(
    source: Path | str | int,
    rig_path: Path | str,
    odometry: Path | str | None,
    truth: Path | str | None,
    settings: Path | str | None,
    fps: float | None,
    max_frames: int | None,
    maps: MapChoice = NEW_MAP,
) -> SlamInputs:
    """Read all inputs of `run_slam`, the film last; raises FacetcamError if one is wrong or does not fit."""
    maps.check()
    rig = Rig.load(rig_path)
    config = load_config(SlamConfig, settings)
    wheels = read_odometry(odometry) if odometry is not None else None
    true_path = read_tum(truth) if truth is not None else None
    film = open_source(source, fps)
    require_size(film, rig)
    if wheels is not None:
        require_cover(wheels, film, max_frames)
    return SlamInputs(film, Path(rig_path), rig, config, wheels, true_path, maps)


def require_size(film: Source, rig: Rig) -> None:
    """Raise SourceError unless the frames are as large as the rig's camera says."""
    width, height = film.size
    if (width, height) != (rig.camera.width, rig.camera.height):
        raise SourceError(
            f"{film.name}: frames are {width}x{height}, but the rig's camera is"
            f" {rig.camera.width}x{rig.camera.height}; give the rig of this film"
        )


def require_cover(wheels: Odometry, film: Source, max_frames: int | None) -> None:
    """Raise SourceError unless odometry covers the frames to be read, but for what a wrong clock may hide."""
    if film.time_span is None or not film.count:
        return
    first, last = film.time_span
    interval = (last - first) / max(film.count - 1, 1)
    read = total_frames(film.count, max_frames) or 1
    length = interval * (read - 1)
    slack = max(interval, min(CLOCK_RANGE, 0.1 * length))
    wheels.require_cover((first, first + length), film.name, slack)
