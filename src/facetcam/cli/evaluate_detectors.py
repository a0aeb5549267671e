"""`facetcam evaluate detectors`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from facetcam.cli.options import Format
from facetcam.cli.progress import progress_bar


def detectors(
    datasets: Annotated[
        list[Path],
        typer.Argument(
            help="Folders: Oxford, HPatches, or one view under changing light. Files: images to change."
        ),
    ],
    detector: Annotated[
        list[str] | None, typer.Option("--detector", "-d", help="Compare only this one (may be repeated).")
    ] = None,
    protocols: Annotated[str, typer.Option(help="Letters of A, B, C, D; see the benchmark page.")] = "BD",
    top: Annotated[int, typer.Option(min=1, help="Points of each image that take part.")] = 1000,
    synthetic: Annotated[
        bool, typer.Option("--synthetic", help="Change the first images in known ways too.")
    ] = False,
    form: Annotated[Format, typer.Option("--format", help="How the tables are printed.")] = Format.text,
    out: Annotated[Path | None, typer.Option(help="Folder to make: tables, plots, pictures, a page.")] = None,
) -> None:
    """Compare corner detectors on images with known homographies."""
    from facetcam.pipelines.detectors import run_detectors

    with progress_bar("evaluating") as progress:
        tables = run_detectors(
            datasets,
            out,
            names=detector,
            protocols=protocols,
            top=top,
            synthetic=synthetic,
            progress=progress,
        )
    print(tables[form.value], end="")
