"""`facetcam unwrap`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from facetcam.cli.failures import warn
from facetcam.cli.options import MaxFramesOption, OutOption, RigOption, SourceArgument, output_folder
from facetcam.cli.progress import progress_bar
from facetcam.cli.tables import print_pairs


def parse_size(text: str) -> tuple[int, int]:
    """`640x480` as width and height."""
    width, _, height = text.partition("x")
    if not (width.isdecimal() and height.isdecimal()):
        raise typer.BadParameter(f"{text!r} is not a size like 640x480", param_hint="'--size'")
    return int(width), int(height)


def unwrap(
    source: SourceArgument,
    rig: RigOption,
    out: OutOption = None,
    size: Annotated[
        str | None, typer.Option(metavar="WxH", help="Pixels of each view (default: as fine as the frame).")
    ] = None,
    fov: Annotated[
        float | None, typer.Option(help="Horizontal field of view in degrees (default: all there is).")
    ] = None,
    view: Annotated[
        list[str] | None, typer.Option(help="A view to write; repeatable (default: all).")
    ] = None,
    panorama: Annotated[
        float | None, typer.Option(metavar="METRES", help="Also a panorama, right at this depth.")
    ] = None,
    max_frames: MaxFramesOption = None,
) -> None:
    """Cut frames into upright, un-mirrored views."""
    from facetcam.pipelines import run_unwrap

    folder = output_folder(out, Path(source).stem)
    with progress_bar("unwrapping") as progress:
        result = run_unwrap(
            source,
            rig,
            folder,
            size=parse_size(size) if size is not None else None,
            fov=math.radians(fov) if fov is not None else None,
            views=view,
            panorama_depth=panorama,
            max_frames=max_frames,
            progress=progress,
        )
    for warning in result.warnings:
        warn(warning)
    print_pairs(
        "unwrap", [("frames", str(result.frames)), ("folder", str(folder)), ("report", str(result.report))]
    )
