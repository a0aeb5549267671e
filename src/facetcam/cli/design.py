"""`facetcam design`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from facetcam.cli.options import OutOption, output_folder
from facetcam.cli.pages import keep_open
from facetcam.cli.progress import prompt_bar
from facetcam.cli.tables import print_pairs


def design(
    spec: Annotated[
        str, typer.Argument(metavar="SPEC", help="Design file, rig.yaml, or preset:ryu, :pyramid, :table.")
    ],
    out: OutOption = None,
    search: Annotated[
        bool, typer.Option("--search", help="Find the best parameters in the envelope first.")
    ] = False,
    goal: Annotated[
        str | None,
        typer.Option(
            metavar="GOAL",
            help="What to search for: coverage, resolution, baseline, overlap, or weights as in "
            "coverage=1,baseline=0.5.",
        ),
    ] = None,
    tolerance: Annotated[
        bool, typer.Option(help="Simulate builds with errors, and their calibration.")
    ] = True,
    make: Annotated[
        bool, typer.Option("--make", help="Also templates to cut (SVG, DXF) and a holder to print (STL).")
    ] = False,
    live: Annotated[
        bool, typer.Option("--live", help="A page in the browser with sliders, until Ctrl-C.")
    ] = False,
    port: Annotated[int, typer.Option(min=1, max=65535, help="Of the page of --live.")] = 8080,
    seed: Annotated[int, typer.Option(min=0, help="Of the search and of the build errors.")] = 0,
) -> None:
    """Draw a mirror rig: what it will see and how to build it."""
    from facetcam.pipelines.design import run_design

    folder = output_folder(out, Path(spec).stem.replace(":", "-"))
    if live:
        show_live(spec, folder, port)
        return
    if goal is not None and not search:
        raise typer.BadParameter("a goal is for --search", param_hint="'--goal'")
    result = run_design(
        spec,
        folder,
        search_best=search,
        goal=goal,
        tolerance=tolerance,
        make=make,
        seed=seed,
        stage=prompt_bar,
    )
    analysis = result.analysis
    rows = [
        ("views", ", ".join(analysis.views)),
        ("horizon", f"{100 * analysis.horizon:.1f} %"),
        ("sphere", f"{100 * analysis.sphere:.1f} %"),
        *(
            [("view centres", f"up to {1e3 * analysis.spread:.0f} mm apart")]
            if len(analysis.views) > 1
            else []
        ),
        *((f"longest focal, {words}", f"{camera.focal:.0f} px") for words, camera in result.optimum.items()),
    ]
    if result.found is not None:
        wish = result.spec.search.goal
        if result.found.start is not None:
            rows.append(("score at the start", f"{result.found.start.score(wish):.4f}"))
        rows.append(("score of the best", f"{result.found.best.score(wish):.4f}"))
    if result.tolerance is not None:
        removed = " ".join(f"{100 * share:.1f}" for share in result.tolerance.removed)
        rows.append(("build error calibrated away", f"{removed} %"))
    print_pairs("design", [*rows, ("folder", str(folder)), ("report", str(result.report))])


def show_live(spec: str, folder: Path, port: int) -> None:
    """Keep the page open until Ctrl-C."""
    from facetcam.pipelines.design_live import open_live_page

    keep_open(open_live_page(spec, folder, port), "design")
