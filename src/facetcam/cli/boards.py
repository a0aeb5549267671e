"""`facetcam boards`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from facetcam.cli.options import BoardKind, OutOption, output_folder
from facetcam.cli.tables import print_pairs
from facetcam.cli.unwrap import parse_size


def parse_paper(text: str) -> tuple[float, float]:
    """`A4`, or `300x400` in millimetres."""
    from facetcam.viz.board_pages import PAGES

    known = {name.lower(): size for name, size in PAGES.items()}
    if text.lower() in known:
        return known[text.lower()]
    width, _, height = text.lower().partition("x")
    try:
        size = float(width), float(height)
    except ValueError:
        size = 0.0, 0.0
    if not all(20.0 <= side <= 5000.0 for side in size):
        hint = f"{text!r} is neither {', '.join(PAGES)} nor a size in mm like 300x400"
        raise typer.BadParameter(hint, param_hint="'--paper'")
    return size


def boards(
    kind: Annotated[
        BoardKind, typer.Option("--type", help="charuco, chessboard or aprilgrid.")
    ] = BoardKind.charuco,
    count: Annotated[int, typer.Option(min=1, max=100, help="Boards, with ids of their own.")] = 4,
    squares: Annotated[
        str, typer.Option(metavar="CxR", help="Columns and rows of squares (or tags).")
    ] = "7x10",
    square_mm: Annotated[
        float | None, typer.Option(help="Side of a square in mm (default: what the paper allows).")
    ] = None,
    marker_mm: Annotated[float | None, typer.Option(help="Side of a marker in mm (default: 3/4).")] = None,
    dictionary: Annotated[
        str | None, typer.Option(help="OpenCV's dictionary (default: DICT_5X5_1000, DICT_APRILTAG_36h11).")
    ] = None,
    paper: Annotated[str, typer.Option(help="A4 ... A0, letter, tabloid, or mm like 300x400.")] = "A4",
    fixed: Annotated[
        bool, typer.Option("--fixed", help="The boards will not move against each other between photos.")
    ] = False,
    reprint: Annotated[
        Path | None, typer.Option("--from", help="Print the boards of this boards.yaml instead.")
    ] = None,
    out: OutOption = None,
) -> None:
    """Make calibration boards to print (PDF, PNG)."""
    from facetcam.pipelines.boards import make_boards, run_boards

    folder = output_folder(out, "boards")
    sheet = parse_paper(paper)
    metres = [None if mm is None else mm / 1000.0 for mm in (square_mm, marker_mm)]
    wanted = reprint or make_boards(
        kind.value, count, parse_size(squares), metres[0], metres[1], dictionary, sheet, fixed
    )
    printed = run_boards(wanted, folder, sheet)
    made = printed.boards.boards
    first = made[0]
    rows = [
        ("boards", f"{len(made)}: {', '.join(board.name for board in made)}"),
        (
            "square",
            f"{1000 * first.square:g} mm" + (f", marker {1000 * first.marker:g} mm" if first.marker else ""),
        ),
        ("print", "at 100 %, then measure the bar"),
        ("folder", str(folder)),
    ]
    print_pairs("boards", rows)
