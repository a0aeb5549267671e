"""What a simulated film is made of: scene, rig as drawn and as built, path, light; read and checked."""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from facetcam.config import load_config
from facetcam.errors import FacetcamError, SourceError
from facetcam.io.tables import rows_of_table
from facetcam.io.trajectories import read_tum
from facetcam.rig import Rig
from facetcam.simulation.build import built
from facetcam.simulation.drive import MOST_FRAMES, Drive, SmoothPath, through
from facetcam.simulation.meshes import Mesh
from facetcam.simulation.scene_files import read_scene
from facetcam.simulation.settings import LampSettings, SimulationConfig

Array = NDArray[np.float64]

FPS, FASTEST = 10, 1000  # frames a second
LAMP_EVERY, LAMP_ABOVE, MOST_LAMPS = 4.0, 1.2, 8  # metres along the path and above it


@dataclass(frozen=True, slots=True)
class Options:
    """How a film is to be made; see `run_simulate`."""

    scene: Path
    rig: Path
    trajectory: Path | None = None
    drive: Path | None = None
    settings: Path | None = None
    fps: int | None = None
    speed: float = 0.75
    height: float = 0.9
    scale: float | None = None
    up: str = "z"
    seed: int = 0
    boards: int = 0
    max_frames: int | None = None


@dataclass(frozen=True, eq=False, slots=True)
class SimulationInputs:
    """Checked inputs; `path` is the path as given, `film` the moments of the frames on it, from 0 s on."""

    options: Options
    mesh: Mesh
    drawn: Rig
    true: Rig
    path: Drive
    film: Drive
    fps: int
    config: SimulationConfig
    lamps: tuple[LampSettings, ...]
    warnings: tuple[str, ...]

    @property
    def digest(self) -> str:
        """SHA-256 of all that the frames depend on."""
        shape = [
            len(self.mesh.vertices),
            len(self.mesh.faces),
            self.mesh.vertices[:: 1 + len(self.mesh.vertices) // 999].tolist(),
        ]
        what = [
            asdict(self.config),
            [asdict(lamp) for lamp in self.lamps],
            self.true.digest,
            self.film.poses.tolist(),
            self.fps,
            self.options.seed,
            shape,
        ]
        return hashlib.sha256(json.dumps(what).encode()).hexdigest()


def read_simulation_inputs(options: Options) -> SimulationInputs:
    """Read everything, the scene last; raises FacetcamError if something is wrong or does not fit."""
    if (options.trajectory is None) == (options.drive is None):
        raise FacetcamError("simulate: give either --trajectory or --drive, the path of the rig")
    if options.boards and options.max_frames is not None:
        raise FacetcamError("simulate: --max-frames is for films; --boards says how many photos there are")
    config = load_config(SimulationConfig, options.settings)
    drawn = Rig.load(options.rig)
    drawn.check()
    true = built(drawn, config.build, options.seed)
    true.check()
    path = _path(options)
    film, fps = _frames(path, options)
    scene = read_scene(options.scene, options.scale, options.up)
    lamps = config.light.lamps
    warnings = scene.warnings
    if lamps is None and scene.lamps:
        lamps = by_brightest(scene.lamps)
        warnings += (f"the settings name no lamps; the scene's own {len(lamps)} shine",)
    elif lamps is None:
        lamps = hung_lamps(path.poses[:, :3, 3], scene.mesh)
        warnings += (f"the settings name no lamps; {len(lamps)} hang above the path",)
    return SimulationInputs(options, scene.mesh, drawn, true, path, film, fps, config, lamps, warnings)


def hung_lamps(places: Array, mesh: Mesh) -> tuple[LampSettings, ...]:
    """Lamps along a path (N, 3), above it but inside the scene."""
    away = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1))])
    count = int(np.clip(np.ceil(away[-1] / LAMP_EVERY), 1, MOST_LAMPS))
    chosen: list[Array] = []
    for distance in (np.arange(count) + 0.5) / count * away[-1]:
        x, y, z = (np.interp(distance, away, column) for column in places.T)
        top = float(mesh.bounds[1][2]) - 0.3
        place = np.array([x, y, min(z + LAMP_ABOVE, max(top, z + 0.3))])
        if all(np.linalg.norm(place - other) > LAMP_EVERY / 2 for other in chosen):
            chosen.append(place)
    return tuple(LampSettings((float(x), float(y), float(z))) for x, y, z in chosen)


def by_brightest(lamps: tuple[LampSettings, ...]) -> tuple[LampSettings, ...]:
    """Lamps of a scene, whose candelas say only how they compare, the brightest as bright as one of ours."""
    most = max(lamp.power for lamp in lamps)
    factor = LampSettings((0.0, 0.0, 0.0)).power / most if most > 0.0 else 1.0
    return tuple(replace(lamp, power=lamp.power * factor) for lamp in lamps)


def _path(options: Options) -> Drive:
    if options.trajectory is not None:
        times, poses = read_tum(options.trajectory)
        return Drive(times - times[0], poses)
    assert options.drive is not None
    try:
        return through(read_waypoints(options.drive), options.fps or FPS, options.speed, options.height)
    except SourceError:
        raise
    except FacetcamError as error:
        raise FacetcamError(f"{options.drive}: {error}") from error


def read_waypoints(path: Path) -> Array:
    """Read points x, y in metres (N, 2) from a table `x,y`.

    Raises
    ------
    SourceError
        If the file cannot be read or a line is no point.
    """
    rows = list(rows_of_table(path, ","))
    if not rows or rows[0][1] != ["x", "y"]:
        raise SourceError(f"{path}: the first line must be 'x,y', then a point a line in metres")
    points = []
    for number, row in rows[1:]:
        try:
            x, y = (float(value) for value in row)
        except ValueError as error:
            raise SourceError(f"{path} line {number}: expected two numbers x,y") from error
        if not (math.isfinite(x) and math.isfinite(y)):
            raise SourceError(f"{path} line {number}: '{','.join(row)}' is no place; give finite metres")
        points.append((x, y))
    return np.array(points, dtype=np.float64).reshape(-1, 2)


def _frames(path: Drive, options: Options) -> tuple[Drive, int]:
    """The moments of the frames, evenly spaced, with their poses."""
    step = float(np.median(np.diff(path.times))) if len(path) > 1 else 1.0 / FPS
    fps = options.fps or max(1, min(round(1.0 / step), FASTEST))
    if len(path) > 1 and options.fps is None and path.times[-1] * fps < 1.0:
        raise FacetcamError(
            f"{options.trajectory or options.drive}: its {len(path)} poses take {path.times[-1]:g} s,"
            f" less than one of {fps} frames a second; give times in seconds, or --fps"
        )
    count = int(np.floor(path.times[-1] * fps + 1e-6)) + 1
    count = min(count, options.max_frames or count)
    if count > MOST_FRAMES:
        raise FacetcamError(
            f"{options.trajectory or options.drive}: {path.times[-1]:g} s make {count} frames"
            f" at {fps} a second; give a shorter path, --fps or --max-frames for {MOST_FRAMES} at most"
        )
    times = np.arange(count) / fps
    motion = SmoothPath(path)
    return Drive(times, np.array([motion(float(time)) for time in times])), fps
