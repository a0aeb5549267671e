"""Options that several commands share."""

from __future__ import annotations

import time
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

SourceArgument = Annotated[
    str,
    typer.Argument(metavar="SOURCE", help="Film, folder of images, ROS bag, or number of a live camera."),
]
RigOption = Annotated[
    Path,
    typer.Option("--rig", help="rig.yaml of the camera and its mirrors, or preset:ryu, :pyramid, :table."),
]
OutOption = Annotated[
    Path | None,
    typer.Option("--out", help="Folder to make, never one that exists (default: runs/NAME-TIME)."),
]
FpsOption = Annotated[
    float | None, typer.Option("--fps", help="Frame rate; replaces the source's own times.")
]
MaxFramesOption = Annotated[
    int | None, typer.Option("--max-frames", min=1, help="Stop after so many frames.")
]


class Format(StrEnum):
    """How a table is printed."""

    text = "text"
    csv = "csv"
    json = "json"


class BoardKind(StrEnum):
    """A kind of calibration board."""

    charuco = "charuco"
    chessboard = "chessboard"
    aprilgrid = "aprilgrid"


def output_folder(out: Path | None, name: str) -> Path:
    """The folder asked for, or one named after the source and the time."""
    return out if out is not None else Path("runs") / f"{name}-{time.strftime('%Y%m%d-%H%M%S')}"
