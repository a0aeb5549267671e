"""The film of the demo: a drive through the built-in room, its wheels and its truth, as files."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from facetcam.io.film_writer import write_film
from facetcam.io.odometry import write_odometry
from facetcam.io.trajectories import write_tum
from facetcam.pipelines.progress import Progress
from facetcam.rig import Rig
from facetcam.rig.presets import ryu
from facetcam.simulation.drive import round_the_table, wheel_odometry
from facetcam.simulation.film import Film, renderer_of
from facetcam.simulation.room import furnished_room
from facetcam.simulation.settings import CameraSettings

FPS = 10
LENS = (-0.06, 0.012, 4e-4, -3e-4, 0.0)  # k1, k2, p1, p2, k3


@dataclass(frozen=True, slots=True)
class FilmFiles:
    """What the demo's camera and robot leave in a folder."""

    folder: Path

    @property
    def film(self) -> Path:
        return self.folder / "film.mp4"

    @property
    def rig(self) -> Path:
        return self.folder / "rig.yaml"

    @property
    def odometry(self) -> Path:
        return self.folder / "odometry.csv"

    @property
    def truth(self) -> Path:
        return self.folder / "truth.tum"


def demo_rig() -> Rig:
    """Make the paper's rig with a sensor of half the resolution and a lens that distorts."""
    rig = ryu()
    full = rig.camera
    camera = replace(
        full,
        width=full.width // 2,
        height=full.height // 2,
        fx=full.fx / 2,
        fy=full.fy / 2,
        cx=(full.cx + 0.5) / 2 - 0.5,
        cy=(full.cy + 0.5) / 2 - 0.5,
        distortion=LENS,
    )
    return replace(rig, camera=camera)


def demo_film(frames: int) -> Film:
    """Prepare the film of the first frames of the drive; nothing is rendered yet."""
    quick = CameraSettings(samples=2)
    return Film(demo_rig(), renderer_of(furnished_room()), round_the_table(frames, FPS), settings=quick)


def shoot(film: Film, folder: Path, progress: Progress) -> FilmFiles:
    """Render the film, and write it with rig, odometry and truth, as `facetcam slam` reads them.

    Raises
    ------
    OutputError
        If a file cannot be written.
    """
    files = FilmFiles(folder)
    film.rig.save(files.rig)
    write_tum(files.truth, film.drive.times, film.drive.poses)
    write_odometry(files.odometry, film.drive.times, wheel_odometry(film.drive))
    write_film(files.film, _counted(film, progress), FPS)
    return files


def _counted(film: Film, progress: Progress) -> Iterator[NDArray[np.uint8]]:
    for done, image in enumerate(film, start=1):
        yield image
        progress(done, len(film))
