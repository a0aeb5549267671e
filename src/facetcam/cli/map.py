"""`facetcam map info`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from facetcam.cli.options import Format
from facetcam.cli.tables import print_pairs

if TYPE_CHECKING:
    from facetcam.slam.map.file import MapHeader


def info(
    path: Annotated[Path, typer.Argument(metavar="MAP", help="Map that `facetcam slam` wrote.")],
    format: Annotated[Format, typer.Option(help="How to print it.")] = Format.text,
) -> None:
    """Check a map and say what it holds."""
    from facetcam.slam.map.file import read_map

    header, _ = read_map(path)
    rows = info_rows(header, path.stat().st_size)
    if format is Format.json:
        print(json.dumps(dict(rows), indent=2))
    elif format is Format.csv:
        print("\n".join(f'{name},"{value}"' for name, value in rows))
    else:
        print_pairs("map", rows)


def info_rows(header: MapHeader, n_bytes: int) -> list[tuple[str, str]]:
    """The header of a map in a few lines."""
    rig, unit = header.made_by(), "m" if header.metric else "units of the map"
    sigma = "unknown" if header.scale_sigma is None else f"± {100 * header.scale_sigma:.2g} %"
    return [
        ("saved", header.saved),
        ("rig", f"{rig.camera.width}x{rig.camera.height}, views {', '.join(rig.view_names)}"),
        ("rig digest", header.rig_digest[:16]),
        ("runs", str(header.sessions)),
        ("keyframes, points", f"{header.keyframes}, {header.points}"),
        ("loops closed", str(header.loops)),
        ("size", f"{' x '.join(f'{side:.1f}' for side in header.size)} {unit} (98 % of the points)"),
        ("scale", f"{'METRIC' if header.metric else 'NOT METRIC'} ({sigma})"),
        ("file", f"{n_bytes / 1e6:.1f} MB, undamaged"),
    ]
