"""`facetcam detect`."""

from __future__ import annotations

from typing import Annotated

import typer

from facetcam.cli.failures import warn
from facetcam.cli.options import OutOption, SourceArgument, output_folder
from facetcam.cli.progress import progress_bar
from facetcam.cli.tables import print_pairs


def detect(
    source: SourceArgument,
    out: OutOption = None,
    max_features: Annotated[int, typer.Option(min=1, help="Keep so many of the strongest corners.")] = 1000,
    mode: Annotated[str, typer.Option(help="robust, or paper: equations 1-5 as printed.")] = "robust",
    descriptor: Annotated[
        str, typer.Option(help="gradients match best; binary are small and quick.")
    ] = "gradients",
) -> None:
    """Find SIICF corners: arrays (npz) and pictures."""
    from facetcam.pipelines import run_detect

    folder = output_folder(out, "detect")
    with progress_bar("detecting") as progress:
        result = run_detect(
            source, folder, max_features=max_features, mode=mode, descriptor=descriptor, progress=progress
        )
    for warning in result.warnings:
        warn(warning)
    found = f"{sum(result.corners)} ({sum(result.corners) / max(len(result.corners), 1):.0f} an image)"
    print_pairs("detect", [("images", str(len(result.corners))), ("corners", found), ("folder", str(folder))])
