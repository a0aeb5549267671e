"""From a scene, a rig and a path to a film with its truth."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from facetcam.errors import OutputError, SourceError
from facetcam.io.film_writer import write_film
from facetcam.io.odometry import write_odometry
from facetcam.io.outputs import atomic_write, fresh_folder, require_absent
from facetcam.io.trajectories import write_tum
from facetcam.pipelines.demo import Stage, unwatched
from facetcam.pipelines.progress import keeping
from facetcam.pipelines.shooting import Shooting, read_image
from facetcam.pipelines.simulate_boards import add_boards, round_the_boards, write_board_truth
from facetcam.pipelines.simulate_inputs import (
    Options,
    SimulationInputs,
    read_simulation_inputs,
)
from facetcam.rig import Rig
from facetcam.simulation.build import stated
from facetcam.simulation.drive import Drive, wheel_odometry
from facetcam.simulation.mesh_renderer import MeshRenderer
from facetcam.simulation.path_checks import path_warnings
from facetcam.viz.pages import write_unwrap_report
from facetcam.viz.report import Picture, UnwrapReport

Image = NDArray[np.uint8]
Array = NDArray[np.float64]

STATE = "simulation.json"
SHEET = 6


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
    shooting = Shooting(folder, inputs, film, renderer, still=bool(options.boards))
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


def _encode(shooting: Shooting, fps: int, progress: Any) -> None:
    """Make the film of the frames, then drop their files."""
    (shooting.folder / "film.mp4").unlink(missing_ok=True)

    def frames() -> Iterator[Image]:
        for index in range(len(shooting.film)):
            yield read_image(shooting.file(index))
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


def _report(shooting: Shooting, inputs: SimulationInputs, interrupted: str, warnings: list[str]) -> Simulated:
    """Write the contact sheet."""
    folder = shooting.folder
    chosen = [k for k in _shown(shooting.done) if shooting.file(k).exists()]
    pictures = [Picture(f"{shooting.film.times[k]:.1f} s", read_image(shooting.file(k))) for k in chosen]
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


def _facts(drawn: Rig, true: Rig, shooting: Shooting, inputs: SimulationInputs) -> dict[str, str]:
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
