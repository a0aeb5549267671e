"""`facetcam slam`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from facetcam.cli.failures import warn
from facetcam.cli.options import (
    FpsOption,
    MaxFramesOption,
    OutOption,
    RigOption,
    SourceArgument,
    output_folder,
)
from facetcam.cli.progress import progress_bar
from facetcam.cli.tables import print_pairs
from facetcam.errors import SourceError

if TYPE_CHECKING:
    from facetcam.pipelines import Summary


def slam(
    source: SourceArgument,
    rig: RigOption,
    odometry: Annotated[
        Path | None, typer.Option(help="Wheel odometry, CSV: timestamp,x,y,yaw (s, m, rad), or a ROS bag.")
    ] = None,
    truth: Annotated[
        Path | None, typer.Option(help="True trajectory (TUM) to measure the errors against.")
    ] = None,
    out: OutOption = None,
    map_path: Annotated[
        Path | None,
        typer.Option("--map", help="Map to go on in and extend, or to make (default: in the --out folder)."),
    ] = None,
    localize: Annotated[
        bool, typer.Option("--localize", help="Only find the way in --map; the map stays as it is.")
    ] = False,
    config: Annotated[Path | None, typer.Option(help="Settings of tracking and mapping, YAML.")] = None,
    fps: FpsOption = None,
    max_frames: MaxFramesOption = None,
    real_time: Annotated[
        bool, typer.Option("--real-time", help="Play the film at its own pace, drop frames when behind.")
    ] = False,
    refine_rig: Annotated[
        bool, typer.Option("--refine-rig", help="Refine the rig with the map: rig_refined.yaml.")
    ] = False,
) -> None:
    """Track a film: trajectory, map and report."""
    from facetcam.pipelines import run_slam

    if localize and map_path is None:
        raise typer.BadParameter("--localize needs --map")
    if localize and refine_rig:
        raise typer.BadParameter("--refine-rig moves the map, which --localize keeps; leave one of them out")
    folder = output_folder(out, Path(source).stem)
    with progress_bar("tracking") as progress:
        summary = run_slam(
            source,
            rig,
            folder,
            odometry=odometry,
            truth=truth,
            settings=config,
            map_path=map_path,
            localize=localize,
            fps=fps,
            max_frames=max_frames,
            real_time=real_time,
            refine_rig=refine_rig,
            progress=progress,
        )
    for warning in summary.warnings:
        warn(warning)
    print_pairs("slam", summary_rows(summary))
    if summary.tracked == 0:
        raise SourceError(
            f"{summary.source}: no frame could be tracked; {likely_cause(summary.frames, map_path)}"
        )


def likely_cause(frames: int, map_path: Path | None = None) -> str:
    """What to look at when nothing was tracked."""
    if map_path is not None and map_path.exists():
        return f"is it dark or blank, is this place in {map_path}?"
    if frames < 2:
        return "a single frame shows no motion; give a film"
    return "is it dark or blank, does the camera stand still, is this its rig?"


def summary_rows(summary: Summary) -> list[tuple[str, str]]:
    """The run in a few lines."""
    sigma = f"± {100 * summary.scale_sigma:.2g} %" if summary.scale_sigma is not None else "unknown"
    rows = [
        ("frames", f"{summary.frames}"),
        ("tracked", f"{summary.tracked} ({summary.tracked_percent:g} %)"),
        ("scale", f"{'METRIC' if summary.metric else 'NOT METRIC'} ({sigma})"),
        *((f"  {name}", value) for name, value in summary.if_drawn.items()),
        ("path length", f"{summary.path_length:.2f} {'m' if summary.metric else 'units of the map'}"),
        ("keyframes, map points", f"{summary.keyframes}, {summary.map_points}"),
        ("speed", f"{summary.frames_per_second:.1f} frames/s, decoding included"),
        ("peak memory", f"{summary.peak_memory_mb:.0f} MB"),
    ]
    if summary.saved_map is not None:
        rows.append(("map", str(summary.saved_map)))
    if summary.loops:
        rows.append(("loop closed", "once" if summary.loops == 1 else f"{summary.loops} times"))
    rows += summary.corrections.items()
    if summary.rig_moved:
        name, most = max(summary.rig_moved.items(), key=lambda item: abs(item[1]))
        rows.append(("rig refined", f"{name} moved most, by {most:+.1f} of its sigmas"))
    if summary.errors is not None:
        rows += [
            ("ATE, rigid alignment", f"{summary.errors.ate.rmse:.4f} m"),
            ("ATE, scale aligned too", f"{summary.errors.ate_scaled.rmse:.4f} m"),
            ("scale error", f"{100 * summary.errors.scale_error:+.2f} %"),
        ]
    return [*rows, ("report", str(summary.report))]
