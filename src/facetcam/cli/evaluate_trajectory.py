"""`facetcam evaluate trajectory`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from facetcam.cli.options import Format


def trajectory(
    estimate: Annotated[Path, typer.Argument(help="Estimated trajectory (TUM).")],
    truth: Annotated[Path, typer.Argument(help="True trajectory (TUM).")],
    max_gap: Annotated[float, typer.Option(help="Seconds between poses that are compared, at most.")] = 0.02,
    step: Annotated[int, typer.Option(min=1, help="Poses between which relative errors are taken.")] = 1,
    form: Annotated[Format, typer.Option("--format", help="How the table is printed.")] = Format.text,
    out: Annotated[Path | None, typer.Option(help="Folder to make, with all tables and plots.")] = None,
) -> None:
    """Errors of a trajectory: ATE, RPE and scale, after alignment."""
    from facetcam.pipelines.compare import run_compare

    tables = run_compare(estimate, truth, out, max_gap=max_gap, step=step)
    print(tables[form.value], end="")
