"""Frames of a simulation in a folder, rendered one by one; a run that was cut short is taken up."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam.errors import SourceError
from facetcam.io.outputs import LineWriter, atomic_write, writing
from facetcam.io.tables import read_numbers
from facetcam.pipelines.simulate_inputs import SimulationInputs
from facetcam.simulation.drive import Drive, SmoothPath
from facetcam.simulation.exposures import Exposures
from facetcam.simulation.mesh_renderer import MeshRenderer
from facetcam.simulation.sensor import AutoExposure, Sensor

Image = NDArray[np.uint8]

EXPOSURES, COLUMNS = "exposures.csv", "timestamp,exposure"
DEEPEST = 65.535  # metres that 16 bit hold in millimetres


class Shooting:
    """Frames in a folder, one file each; a later run finds those that are there."""

    def __init__(
        self, folder: Path, inputs: SimulationInputs, film: Drive, renderer: MeshRenderer, still: bool
    ) -> None:
        self.folder, self.film = folder, film
        self.frames = folder / "frames"
        self.done = 0
        self._inputs, self._still = inputs, still
        self._motion = SmoothPath(inputs.path)
        camera = inputs.config.camera
        self._exposures = Exposures(inputs.true, renderer, camera)
        self._sensor = Sensor(camera.full_well, camera.read_noise)
        for name in (self.frames, folder / "depth"):
            with writing(name):
                name.mkdir(exist_ok=True)

    def file(self, index: int) -> Path:
        return self.frames / f"{index:06d}.png"

    def run(self, depth: bool) -> Iterator[int]:
        """Render what is missing; yields the number of frames that are there."""
        auto, first = self._taken_up()
        self.done = first
        if not depth:
            (self.folder / "depth").rmdir()
        with _Exposures(self.folder / EXPOSURES) as table:
            for index in range(first, len(self.film)):
                time = float(self.film.times[index])
                radiance = self._exposures.radiance(self._pose(index), time)
                exposure = float(self._inputs.config.camera.exposure or auto.follow(radiance, time))
                if depth:
                    self._write_depth(index)
                image = self._develop(radiance, exposure, index)
                atomic_write(self.file(index), png(image))
                table.append(f"{time:.6f},{exposure!r}")
                self.done = index + 1
                yield self.done

    def _taken_up(self) -> tuple[AutoExposure, int]:
        """Automatic exposure as the last frame left it, and the first frame to render."""
        auto = AutoExposure(lag=self._inputs.config.camera.lag)
        table = self.folder / EXPOSURES
        begun = table.exists() and table.stat().st_size > len(COLUMNS) + 1
        rows: list[list[float]] = read_numbers(table, COLUMNS, header=True).tolist() if begun else []
        first = 0
        for time, exposure in rows:
            if first < len(self.film) and self.file(first).exists():
                auto = AutoExposure(auto.lag, float(exposure), float(time))
                first += 1
        if self._still:
            auto.lag = 1e-3  # photos are taken one by one, each well exposed
        return auto, first

    def _pose(self, index: int) -> Any:
        if self._still:
            return lambda time: self.film.poses[index]
        return self._motion

    def _develop(self, radiance: NDArray[np.float32], exposure: float, index: int) -> Image:
        noisy = self._inputs.config.camera.noise
        rng = np.random.default_rng([self._inputs.options.seed, index]) if noisy else None
        return self._sensor.develop(radiance, exposure, rng)

    def _write_depth(self, index: int) -> None:
        metres = self._exposures.depth(self.film.poses[index])
        metres[~(metres < DEEPEST)] = 0.0
        atomic_write(self.folder / "depth" / f"{index:06d}.png", png(np.rint(1e3 * metres).astype(np.uint16)))


class _Exposures(LineWriter):
    """The table of exposures, taken up where it was left."""

    def __init__(self, path: Path) -> None:
        if path.exists():
            self.path = path
            with writing(path):
                self._file = path.open("a", encoding="utf-8", buffering=1)
        else:
            super().__init__(path)
            self.write(COLUMNS)

    def append(self, line: str) -> None:
        self.write(line)


def png(image: NDArray[np.generic]) -> bytes:
    return bytes(cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1].tobytes())


def read_image(path: Path) -> Image:
    image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if image is None:
        raise SourceError(f"{path}: a frame that was rendered is gone or damaged; render it again")
    return np.asarray(image, dtype=np.uint8)
