"""Films of a furnished house for `slam_rigs.py`: several rigs, rooms, lights and ways to move."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from facetcam.design.family import make_rig
from facetcam.design.spec import read_spec
from facetcam.errors import SourceError
from facetcam.geometry import se3
from facetcam.io.trajectories import write_tum
from facetcam.pipelines.simulate import run_simulate
from facetcam.pipelines.simulate_inputs import Options
from facetcam.rig import Camera, Rig, View, presets
from facetcam.simulation.drive import through

Array = NDArray[np.float64]

DESIGNS = Path(__file__).parents[1] / "examples" / "designs"
FPS, WIDTH = 10.0, 1000

# Waypoints in metres: round the dining table, round a partition of the bedroom, through the living room.
DINING = [(4.0, 0.6), (5.1, -0.7), (6.6, -1.2), (7.9, -0.5), (8.3, 1.0), (7.9, 2.4), (6.5, 2.65), (5.2, 2.1)]
BEDROOM = [(-1.2, -0.7), (-2.7, -0.3), (-4.3, 0.1), (-6.2, 0.1), (-8.0, -0.1), (-8.9, -1.4), (-7.6, -2.7)]
LIVING = [(-1.6, 0.6), (-0.6, 1.9), (0.9, 2.8), (2.6, 2.4), (4.0, 0.9), (3.9, -1.2), (3.0, -3.2), (1.0, -3.9)]

BUILD = "build: {tilt_degrees: 0.3, shift_mm: 0.2, camera_degrees: 0.2, camera_mm: 0.2, focal_percent: 0.3}\n"
EVEN = "camera: {samples: 2, exposure_time: 0.004, readout: 0.01, vignetting: 0.3}\n" + BUILD
POOR = """
camera: {samples: 2, exposure_time: 0.02, readout: 0.02, vignetting: 0.6, lag: 0.8}
light:
  ambient: [0.06, 0.06, 0.06]
  sky: [0.1, 0.11, 0.14]
  lamps:
  - position: [4.6, 0.2, 2.1]
    power: 0.8
    schedule: [{at: 3, do: flicker}, {at: 6, do: dim, level: 0.3, over: 1}]
  - {position: [7.0, -2.0, 2.1], power: 0.8, schedule: [{at: 5, do: off}, {at: 9, do: on}]}
  - {position: [8.0, 2.2, 2.1], power: 0.8, schedule: [{at: 8, do: flicker}]}
  - {position: [3.0, -1.5, 2.1], power: 0.8}
"""


def resized(rig: Rig, width: int) -> Rig:
    """The same rig with a sensor of another resolution."""
    c, s = rig.camera, width / rig.camera.width
    size = {"width": width, "height": round(c.height * s), "fx": c.fx * s, "fy": c.fy * s}
    return replace(rig, camera=replace(c, **size, cx=(c.cx + 0.5) * s - 0.5, cy=(c.cy + 0.5) * s - 0.5))


def with_lens(rig: Rig) -> Rig:
    """The rig behind a lens that distorts."""
    return replace(rig, camera=replace(rig.camera, distortion=(-0.08, 0.03, 3e-4, -2e-4, 0.0)))


def ahead() -> Rig:
    """One ordinary camera without mirrors that looks ahead."""
    T = se3.from_rotation_translation([[1, 0, 0], [0, 0, 1], [0, -1, 0]], [0.0, 0.0, 0.0])
    camera = Camera("brown-conrady", 1600, 1200, 1100.0, 1100.0, 799.5, 599.5, (0.0,) * 5)
    return Rig(camera, T, {}, {"direct": View(())})


def _ryu() -> Rig:
    return with_lens(presets.ryu())


def _six_faces() -> Rig:
    return presets.ryu(faces=6, depth=0.045)


def _table() -> Rig:
    return presets.table(width=0.12, height=0.1)


def _five_faces() -> Rig:
    return with_lens(presets.ryu(faces=5))


def _pyramid_of(faces: int) -> Callable[[], Rig]:
    return lambda: presets.pyramid(faces=faces)


@dataclass(frozen=True)
class Film:
    """A film to be made: rig, way, roughness (1: ramps of 15 cm, tilts of some degrees), light, m/s."""

    name: str
    rig: Callable[[], Rig]
    way: list[tuple[float, float]]
    rough: float = 0.0
    settings: str = EVEN
    frames: int = 110
    seed: int = 1
    speed: float = 0.75

    @property
    def slug(self) -> str:
        return self.name.replace(" ", "-").replace(",", "")


FILMS = (
    Film("ryu, rough", _ryu, BEDROOM, rough=1.0, seed=11),
    Film("pyramid, rough", presets.pyramid, DINING, rough=1.0, seed=12),
    Film("ryu, poor light", _ryu, DINING, 0.3, POOR + BUILD, seed=13),
    Film(
        "five wide faces",
        lambda: make_rig(read_spec(DESIGNS / "five-face-pyramid.yaml")),
        LIVING,
        0.5,
        frames=80,
        seed=14,
    ),
    Film(
        "stereo adapter",
        lambda: Rig.load(DESIGNS / "stereo-adapter-rig.yaml"),
        LIVING[::-1],
        0.5,
        frames=80,
        seed=15,
    ),
    Film("one camera", lambda: with_lens(ahead()), LIVING, 0.5, frames=80, seed=16),
    Film("table", _table, DINING[::-1], 0.3, frames=80, seed=17),
    Film("ryu, six faces", _six_faces, LIVING, 0.0, frames=80, seed=18),
)

_FIVE = next(film for film in FILMS if film.name == "five wide faces").rig
_STEREO = next(film for film in FILMS if film.name == "stereo adapter").rig

# The same rigs elsewhere.
ELSEWHERE = (
    Film("ryu, rough, dining", _ryu, DINING, 1.0, seed=21),
    Film("ryu, poor light, rough", _ryu, DINING, 1.0, POOR + BUILD, seed=22),
    Film("ryu, poor light, living", presets.ryu, LIVING, 0.2, POOR + BUILD, seed=28),
    Film("table, rough, living", _table, LIVING, 1.0, seed=23),
    Film("table, bedroom", _table, BEDROOM, 0.2, seed=30),
    Film("pyramid, dining", presets.pyramid, DINING[::-1], seed=24),
    Film("pyramid, rough, living", presets.pyramid, LIVING, 1.0, seed=25),
    Film("stereo adapter, bedroom", _STEREO, BEDROOM[::-1], 0.3, seed=26),
    Film("five wide faces, dining", _FIVE, DINING, 0.3, seed=27),
    Film("six faces, bedroom", _six_faces, BEDROOM[::-1], 0.7, seed=29),
    Film("pyramid, dining, rough", presets.pyramid, DINING[::-1], 0.8, frames=80, seed=41),
    Film("ryu, living, rough", _ryu, LIVING, 1.0, frames=80, seed=42),
    Film("table, dining, rough", _table, DINING, 1.0, frames=80, seed=43),
    Film("stereo adapter, dining", _STEREO, DINING, 0.5, frames=80, seed=44),
    Film("six faces, dining", _six_faces, DINING, 0.6, frames=80, seed=45),
    Film("five wide faces, bedroom", _FIVE, BEDROOM, 0.5, frames=80, seed=46),
    Film("ryu, poor light, bedroom", presets.ryu, BEDROOM, 0.3, POOR + BUILD, frames=80, seed=47),
    Film("pyramid, bedroom", presets.pyramid, BEDROOM[::-1], 0.5, frames=80, seed=48),
    Film("stereo adapter, living, rough", _STEREO, LIVING, 0.8, frames=80, seed=61),
    Film("pyramid, living, poor light", presets.pyramid, LIVING[::-1], 0.3, POOR + BUILD, frames=80, seed=62),
    Film("ryu, bedroom", _ryu, BEDROOM[::-1], 0.6, frames=80, seed=63),
    Film("table, bedroom, rough", _table, BEDROOM[::-1], 0.8, frames=80, seed=64),
    Film("six faces, living, rough", _six_faces, LIVING[::-1], 0.8, frames=80, seed=65),
    Film("five wide faces, dining, rough", _FIVE, DINING[::-1], 0.8, frames=80, seed=66),
    Film("ryu, dining", presets.ryu, DINING[::-1], 0.5, frames=80, seed=67),
    Film("stereo adapter, dining, back", _STEREO, DINING[::-1], 0.3, frames=80, seed=68),
    Film("pyramid, living", presets.pyramid, LIVING, 0.6, frames=80, seed=81),
    Film("ryu, rough, living, back", _ryu, LIVING[::-1], 0.9, frames=80, seed=82),
    Film("table, living", _table, LIVING[::-1], 0.4, frames=80, seed=83),
    Film("stereo adapter, bedroom, forth", _STEREO, BEDROOM, 0.6, frames=80, seed=84),
    Film("six faces, dining, back", _six_faces, DINING[::-1], 0.4, frames=80, seed=85),
    Film("five wide faces, living, back", _FIVE, LIVING[::-1], 0.7, frames=80, seed=86),
    Film("ryu, poor light, dining, back", presets.ryu, DINING[::-1], 0.5, POOR + BUILD, frames=80, seed=87),
    Film("pyramid, poor light, bedroom", presets.pyramid, BEDROOM, 0.4, POOR + BUILD, frames=80, seed=88),
    Film("three-face pyramid, dining", _pyramid_of(3), DINING, 0.6, frames=80, seed=108),
    Film("five faces, bedroom", _five_faces, BEDROOM[::-1], 0.5, frames=80, seed=109),
    Film("stereo adapter, poor light, living", _STEREO, LIVING[::-1], 0.4, POOR + BUILD, frames=80, seed=110),
    Film("table, dining, forth", _table, DINING, 0.5, frames=80, seed=205),
    Film("five-face pyramid, poor light", _pyramid_of(5), BEDROOM, 0.6, POOR + BUILD, frames=80, seed=207),
    Film("one camera, dining", lambda: with_lens(ahead()), DINING, 0.4, frames=80, seed=208),
    Film("ryu, fast, dining", _ryu, DINING[::-1], 0.5, frames=60, seed=209, speed=1.5),
    Film("pyramid, fast, living", presets.pyramid, LIVING[::-1], 0.8, frames=60, seed=210, speed=1.5),
    Film("six faces, poor light, living", _six_faces, LIVING, 0.4, POOR + BUILD, frames=80, seed=211),
    Film("stereo adapter, fast, bedroom", _STEREO, BEDROOM[::-1], 0.4, frames=60, seed=212, speed=1.5),
    Film("five wide faces, poor light, dining", _FIVE, DINING, 0.5, POOR + BUILD, frames=80, seed=213),
)

# What nothing was changed by: rendered when the version that they judge was done.
UNSEEN = (
    Film("ryu, dining, forth", presets.ryu, DINING, 0.7, frames=80, seed=301),
    Film("three-face pyramid, living", _pyramid_of(3), LIVING, 0.5, frames=80, seed=302),
    Film("table, poor light, bedroom", _table, BEDROOM, 0.3, POOR + BUILD, frames=80, seed=303),
    Film("five faces, dining, rough", _five_faces, DINING[::-1], 0.9, frames=80, seed=304),
    Film("six faces, bedroom, forth", _six_faces, BEDROOM, 0.5, frames=80, seed=305),
    Film("pyramid, fast, dining", presets.pyramid, DINING, 0.5, frames=60, seed=306, speed=1.5),
    Film("one camera, bedroom", lambda: with_lens(ahead()), BEDROOM, 0.4, frames=80, seed=307),
    Film("ryu, fast, bedroom", _ryu, BEDROOM, 0.6, frames=60, seed=308, speed=1.5),
)


def path_of(film: Film) -> tuple[Array, Array]:
    """Times and poses: a drive along the film's way, over ramps and bumps, with pitch and roll."""
    drive = through(np.array(film.way), FPS, film.speed)
    times, poses = drive.times[: film.frames], drive.poses[: film.frames].copy()
    rng = np.random.default_rng(film.seed)
    climb, pitch, roll = (_wave(times, rng, slow) for slow in (4.0, 1.5, 2.0))
    for T, up, nose, side in zip(poses, 0.15 * climb, np.radians(4.0) * pitch, np.radians(3.0) * roll):
        T[:3, :3] = T[:3, :3] @ se3.exp(film.rough * np.array([nose, side, 0, 0, 0, 0]))[:3, :3]
        T[2, 3] += film.rough * up
    return times, poses


def _wave(times: Array, rng: np.random.Generator, period: float) -> Array:
    """Smooth noise of about unit height, 0 at first."""
    phases, periods = rng.uniform(0, 2 * np.pi, 4), period * rng.uniform(0.6, 2.5, 4)
    wave = np.sin(2 * np.pi * times[:, None] / periods + phases).sum(axis=1) / 2.0
    return np.asarray(wave - wave[0])


def render(film: Film, scene: Path, cache: Path, threads: int | None = None) -> Path:
    """Folder of a film with its truth; what is missing is rendered, what was cut short goes on."""
    folder = cache / film.slug
    inputs = cache / f"{film.slug}-inputs"
    out = folder / "film.mp4"
    if out.exists() and not (folder / "frames").exists():
        return folder
    inputs.mkdir(parents=True, exist_ok=True)
    rig, path, settings = (inputs / name for name in ("rig.yaml", "path.tum", "settings.yaml"))
    if not rig.exists():
        resized(film.rig(), WIDTH).save(rig)
    write_tum(path, *path_of(film))
    settings.write_text(film.settings)
    options = Options(scene, rig, path, settings=settings, seed=film.seed)
    begun = folder.exists()
    try:
        done = run_simulate(options, folder, resume=begun, threads=threads)
    except SourceError as error:
        older = f"; {folder} may be of an older version: delete it" if begun else ""
        raise SystemExit(f"{error}{older}") from error
    for warning in done.warnings:
        print(f"{film.name}: {warning}")
    return folder
