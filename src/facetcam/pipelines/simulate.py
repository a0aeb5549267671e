"""From a scene, a rig and a path to a film with its truth."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam.errors import OutputError, SourceError
from facetcam.io.film_writer import write_film
from facetcam.io.odometry import write_odometry
from facetcam.io.outputs import LineWriter, atomic_write, fresh_folder, require_absent, writing
from facetcam.io.tables import read_numbers
from facetcam.io.trajectories import write_tum
from facetcam.pipelines.demo import Stage, unwatched
from facetcam.pipelines.progress import keeping
from facetcam.pipelines.simulate_boards import add_boards, round_the_boards, write_board_truth
from facetcam.pipelines.simulate_inputs import (
    Options,
    SimulationInputs,
    pose_between,
    read_simulation_inputs,
)
from facetcam.rig import Rig
from facetcam.simulation.build import stated
from facetcam.simulation.drive import Drive, wheel_odometry
from facetcam.simulation.exposures import Exposures
from facetcam.simulation.mesh_renderer import MeshRenderer
from facetcam.simulation.path_checks import path_warnings
from facetcam.simulation.sensor import AutoExposure, Sensor
from facetcam.viz.pages import write_unwrap_report
from facetcam.viz.report import Picture, UnwrapReport

Image = NDArray[np.uint8]
Array = NDArray[np.float64]

STATE, EXPOSURES = "simulation.json", "exposures.csv"
COLUMNS = "timestamp,exposure"
SHEET = 6
DEEPEST = 65.535  # metres that 16 bit hold in millimetres


@dataclass(frozen=True, slots=True)
class Simulated:
    """Number of frames in the folder, the contact sheet, and what was not as it should be."""

    frames: int
    report: Path
    warnings: tuple[str, ...]


def run_simulate(
    options: Options,
    out: Path | str,
    *,
    png: bool = False,
    depth: bool = False,
    resume: bool = False,
    threads: int | None = None,
    stage: Stage = unwatched,
) -> Simulated:
    """Film a scene through a rig's mirrors, with the truth of everything.

    Parameters
    ----------
    options : Options
        Scene (`.glb` and others), rig, path (`trajectory` in TUM format or `drive`, waypoints `x,y`),
        settings, frames a second, scale and upward axis of the scene, seed; `boards` asks for so many
        calibration photos at the start of the path instead of a film.
    out : path
        Folder to make: `film.mp4` (or `frames/`), `truth.tum`, `odometry.csv`, `rig_nominal.yaml`,
        `rig_true.yaml`, `simulation.json`, `report.html`.
    png : bool
        Keep the frames as PNG instead of a film.
    depth : bool
        Also write `depth/000000.png`, ..., 16 bit, millimetres along the ray from the lens; 0 for none.
    resume : bool
        Go on in the folder of a run of the same inputs that was cut short.
    threads : int, optional
        All processors by default; the frames do not depend on it.
    stage : callable
        Opens a progress bar for each stage.

    Raises
    ------
    FacetcamError
        Before `out` is made, if an input is wrong; later, if the disk is full.
    """
    if not resume:
        require_absent(out)
    inputs = read_simulation_inputs(options)
    board_set = None
    mesh, film = inputs.mesh, inputs.film
    if options.boards:
        film = round_the_boards(inputs.path.poses[0], options.boards, options.seed)
        mesh, board_set = add_boards(mesh, inputs.drawn, inputs.path.poses[0])
    until = float(film.times[-1])
    lamps = tuple(lamp.lamp(options.seed + k, until) for k, lamp in enumerate(inputs.lamps))
    folder = _folder(Path(out), inputs.digest, resume)
    with stage("light") as progress:
        light = inputs.config.light
        renderer = MeshRenderer(mesh, lamps, light.ambient, light.sky, threads, progress)
    warnings = [*inputs.warnings, *path_warnings(renderer, film.times, film.poses)]
    if renderer.coarser:
        warnings.append(f"{renderer.coarser} textures are shown coarser, to keep memory small")
    if board_set is not None:
        write_board_truth(folder, board_set, film, resume)
    _write_truth(folder, inputs, film, wheels=not options.boards)
    shooting = _Shooting(folder, inputs, film, renderer, still=bool(options.boards))
    with (
        keeping(folder, lambda reason: _report(shooting, inputs, reason, warnings)),
        stage("frames") as progress,
    ):
        for done in shooting.run(depth):
            progress(done, len(film))
    if not (png or options.boards):
        with stage("film") as progress:
            _encode(shooting, inputs.fps, progress)
    _note(folder, inputs, warnings, finished=True)
    return _report(shooting, inputs, "", warnings)


class _Shooting:
    """Frames in a folder, one file each; a later run finds those that are there."""

    def __init__(
        self, folder: Path, inputs: SimulationInputs, film: Drive, renderer: MeshRenderer, still: bool
    ) -> None:
        self.folder, self.film = folder, film
        self.frames = folder / "frames"
        self.done = 0
        self._inputs, self._still = inputs, still
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
                atomic_write(self.file(index), _png(image))
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
        return lambda time: pose_between(self._inputs.path, time)

    def _develop(self, radiance: NDArray[np.float32], exposure: float, index: int) -> Image:
        noisy = self._inputs.config.camera.noise
        rng = np.random.default_rng([self._inputs.options.seed, index]) if noisy else None
        return self._sensor.develop(radiance, exposure, rng)

    def _write_depth(self, index: int) -> None:
        metres = self._exposures.depth(self.film.poses[index])
        metres[~(metres < DEEPEST)] = 0.0
        atomic_write(
            self.folder / "depth" / f"{index:06d}.png", _png(np.rint(1e3 * metres).astype(np.uint16))
        )


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


def _folder(out: Path, digest: str, resume: bool) -> Path:
    """Make the folder, or take up the one of a run that was cut short."""
    if not resume:
        folder = fresh_folder(out)
        atomic_write(folder / STATE, json.dumps({"inputs": digest, "finished": False}) + "\n")
        return folder
    try:
        state = json.loads((out / STATE).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise SourceError(f"{out}: no simulation to resume there; leave out --resume to begin one") from error
    if state.get("finished"):
        raise OutputError(f"{out}: that simulation is finished; choose another --out")
    if state.get("inputs") != digest:
        raise OutputError(f"{out}: begun with other inputs; give the same ones, or another --out")
    return out


def _write_truth(folder: Path, inputs: SimulationInputs, film: Drive, wheels: bool) -> None:
    for name, rig in (("rig_nominal.yaml", inputs.drawn), ("rig_true.yaml", inputs.true)):
        if not (folder / name).exists():
            rig.save(folder / name)
    write_tum(folder / "truth.tum", film.times, film.poses)
    if wheels:
        write_odometry(folder / "odometry.csv", film.times, wheel_odometry(film, inputs.options.seed))


def _encode(shooting: _Shooting, fps: int, progress: Any) -> None:
    """Make the film of the frames, then drop their files."""
    (shooting.folder / "film.mp4").unlink(missing_ok=True)

    def frames() -> Iterator[Image]:
        for index in range(len(shooting.film)):
            yield _read(shooting.file(index))
            progress(index + 1, len(shooting.film))

    write_film(shooting.folder / "film.mp4", frames(), fps)
    for index in range(len(shooting.film)):
        if index not in _shown(shooting.done):
            shooting.file(index).unlink()


def _note(folder: Path, inputs: SimulationInputs, warnings: list[str], finished: bool) -> None:
    """Write what the film was made of, and by how much the rig is off its drawing."""
    off = stated(inputs.drawn, inputs.true)
    note = {
        "inputs": inputs.digest,
        "finished": finished,
        "scene": inputs.options.scene.name,
        "seed": inputs.options.seed,
        "fps": inputs.fps,
        "warnings": warnings,
        "off_the_drawing": off,
        "settings": asdict(inputs.config) | {"lamps": [asdict(lamp) for lamp in inputs.lamps]},
    }
    atomic_write(folder / STATE, json.dumps(note, indent=1) + "\n")


def _shown(frames: int) -> list[int]:
    return sorted({round(k * (frames - 1) / (SHEET - 1)) for k in range(SHEET)}) if frames else []


def _report(
    shooting: _Shooting, inputs: SimulationInputs, interrupted: str, warnings: list[str]
) -> Simulated:
    """Write the contact sheet."""
    folder = shooting.folder
    chosen = [k for k in _shown(shooting.done) if shooting.file(k).exists()]
    pictures = [Picture(f"{shooting.film.times[k]:.1f} s", _read(shooting.file(k))) for k in chosen]
    facts = _facts(inputs.drawn, inputs.true, shooting, inputs) | {
        f"warning {k}": text for k, text in enumerate(warnings, start=1)
    }
    rows = [pictures[k : k + 2] for k in range(0, len(pictures), 2)]
    title = f"{inputs.options.scene.stem} through {len(inputs.true.views)} views"
    write_unwrap_report(
        UnwrapReport(title, rows, interrupted, facts, "Simulated film"), folder / "report.html"
    )
    if not interrupted and (folder / "film.mp4").exists():
        for index in chosen:
            shooting.file(index).unlink()
        shooting.frames.rmdir()
    return Simulated(shooting.done, folder / "report.html", tuple(warnings))


def _facts(drawn: Rig, true: Rig, shooting: _Shooting, inputs: SimulationInputs) -> dict[str, str]:
    off = stated(drawn, true)
    return {
        "frames": f"{shooting.done} of {len(shooting.film)}",
        "triangles": f"{len(inputs.mesh.faces)}",
        "rays a pixel": f"{inputs.config.camera.samples}",
        "lamps": f"{len(inputs.lamps)}",
        "rig": "as drawn"
        if drawn is true
        else "off its drawing: "
        + "; ".join(f"{name} {o['turn_degrees']:.2f}° {o['shift_mm']:.2f} mm" for name, o in off.items()),
    }


def _png(image: NDArray[np.generic]) -> bytes:
    return bytes(cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1].tobytes())


def _read(path: Path) -> Image:
    image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if image is None:
        raise SourceError(f"{path}: a frame that was rendered is gone or damaged; render it again")
    return np.asarray(image, dtype=np.uint8)
