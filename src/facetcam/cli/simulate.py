"""`facetcam simulate`."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from facetcam.cli.failures import warn
from facetcam.cli.options import MaxFramesOption, OutOption, RigOption, output_folder
from facetcam.cli.progress import prompt_bar
from facetcam.cli.tables import print_pairs


class Axis(StrEnum):
    """Axis of the scene's file that points up."""

    z = "z"
    y = "y"


def simulate(
    scene: Annotated[Path, typer.Argument(metavar="SCENE", help="Scene with textures: .glb, .gltf, .obj.")],
    rig: RigOption,
    out: OutOption = None,
    trajectory: Annotated[
        Path | None, typer.Option(help="Path of the rig, TUM format; sets the frame rate too.")
    ] = None,
    drive: Annotated[
        Path | None, typer.Option(help="Points x,y in metres (CSV) through which the rig drives.")
    ] = None,
    settings: Annotated[Path | None, typer.Option(help="YAML of camera, light and build errors.")] = None,
    fps: Annotated[
        int | None, typer.Option(min=1, help="Frames a second (default: the path's, or 10).")
    ] = None,
    speed: Annotated[float, typer.Option(help="Metres a second of --drive.")] = 0.75,
    height: Annotated[float, typer.Option(help="Metres of the rig above z = 0 in --drive.")] = 0.9,
    boards: Annotated[
        int,
        typer.Option(min=0, max=10_000, help="So many calibration photos at the path's start, not a film."),
    ] = 0,
    depth: Annotated[
        bool, typer.Option("--depth", help="Also depth/000000.png, 16 bit, millimetres.")
    ] = False,
    png: Annotated[bool, typer.Option("--png", help="Frames as PNG instead of a film.")] = False,
    scale: Annotated[
        float | None, typer.Option(help="Metres a unit of the scene (default: 1, or 0.001 if it is huge).")
    ] = None,
    up: Annotated[Axis, typer.Option(help="Axis of the scene that points up.")] = Axis.z,
    seed: Annotated[int, typer.Option(min=0, help="Of noise, build errors, wheels and flicker.")] = 0,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on in --out where a run was cut short.")
    ] = False,
    max_frames: MaxFramesOption = None,
) -> None:
    """Film a textured scene through a rig's mirrors, with the truth."""
    from facetcam.pipelines.simulate import run_simulate
    from facetcam.pipelines.simulate_inputs import Options

    folder = output_folder(out, scene.stem)
    options = Options(
        scene, rig, trajectory, drive, settings, fps, speed, height, scale, str(up), seed, boards, max_frames
    )
    result = run_simulate(options, folder, png=png, depth=depth, resume=resume, stage=prompt_bar)
    for warning in result.warnings:
        warn(warning)
    print_pairs(
        "simulate", [("frames", str(result.frames)), ("folder", str(folder)), ("report", str(result.report))]
    )
