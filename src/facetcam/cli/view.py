"""`facetcam view`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from facetcam.cli.pages import keep_open


def view(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Folder that `facetcam slam` wrote.")],
    port: Annotated[int, typer.Option(min=1, max=65535, help="Of the page.")] = 8080,
) -> None:
    """Show a run in the browser: its map, its path, the rig at any frame."""
    from facetcam.pipelines.view import open_run_page

    keep_open(open_run_page(run, port), "view")
