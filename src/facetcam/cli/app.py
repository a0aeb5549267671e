"""`facetcam`: the list of commands."""

from __future__ import annotations

import os
from typing import Annotated

import typer

from facetcam import __version__
from facetcam.cli.boards import boards
from facetcam.cli.calibrate import calibrate
from facetcam.cli.demo import demo
from facetcam.cli.design import design
from facetcam.cli.detect import detect
from facetcam.cli.evaluate_detectors import detectors
from facetcam.cli.evaluate_trajectory import trajectory
from facetcam.cli.failures import DEBUG, in_one_line
from facetcam.cli.map import info
from facetcam.cli.simulate import simulate
from facetcam.cli.slam import slam
from facetcam.cli.unwrap import unwrap
from facetcam.cli.usage import OneLineGroup
from facetcam.cli.view import view

app = typer.Typer(
    name="facetcam",
    cls=OneLineGroup,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # plain help: panels and colours would double the time to start
    context_settings={"help_option_names": ["-h", "--help"]},
)
maps = typer.Typer(help="Look into saved maps.", no_args_is_help=True)
evaluate = typer.Typer(help="Compare results with the truth.", no_args_is_help=True)


def show_version(wanted: bool) -> None:
    if wanted:
        print(f"facetcam {__version__}")
        raise typer.Exit


@app.callback()
def root(
    debug: Annotated[bool, typer.Option("--debug", help="Show tracebacks of unexpected failures.")] = False,
    version: Annotated[
        bool, typer.Option("--version", help="Show the version.", callback=show_version, is_eager=True)
    ] = False,
) -> None:
    """Room-wide vision from one camera and a few flat mirrors."""
    DEBUG.set(debug)


for command in (demo, slam, view, simulate, unwrap, boards, calibrate, detect, design):
    app.command()(in_one_line(command))
for comparison in (trajectory, detectors):
    evaluate.command()(in_one_line(comparison))
app.add_typer(evaluate, name="evaluate")
maps.command()(in_one_line(info))
app.add_typer(maps, name="map")


def main() -> None:
    """Run the command line; exits with 0 done, 1 failed on data, 2 wrong usage, 130 interrupted."""
    os.environ.setdefault("OPENCV_LOG_LEVEL", "OFF")  # its complaints are said again in our own words
    app()
