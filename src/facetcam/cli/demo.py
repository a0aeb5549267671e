"""`facetcam demo`."""

from __future__ import annotations

from typing import Annotated

import typer

from facetcam.cli.options import OutOption, output_folder
from facetcam.cli.progress import prompt_bar
from facetcam.cli.tables import print_pairs
from facetcam.errors import FacetcamError


def demo(
    out: OutOption = None,
    quick: Annotated[bool, typer.Option("--quick", help="Only the first third of the drive.")] = False,
) -> None:
    """Run the whole line on a small built-in scene with truth."""
    from facetcam.pipelines.demo import run_demo

    result = run_demo(output_folder(out, "demo"), quick=quick, stage=prompt_bar)
    rows = [
        (check.quantity, f"{check.value}  (expected {check.expected}{'' if check.passed else ', missed'})")
        for check in result.checks
    ]
    print_pairs("demo, against the truth", [*rows, ("report", str(result.report))])
    if not result.passed:
        missed = sum(not check.passed for check in result.checks)
        raise FacetcamError(
            f"demo: {missed} of {len(rows)} quantities are not as expected; see {result.report}"
        )
