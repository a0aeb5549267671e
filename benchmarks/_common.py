"""What the benchmarks share: where the data is, tables, and what machine ran them."""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table


def data_folder() -> Path:
    """The folder of films and rigs: FACETCAM_DATA, or `shared/data` beside the repository."""
    folder = Path(os.environ.get("FACETCAM_DATA", Path(__file__).parents[2] / "shared" / "data"))
    if not folder.is_dir():
        sys.exit(f"{folder}: no data there, nothing measured; set FACETCAM_DATA")
    return folder


def photographs(count: int = 20) -> list[NDArray[np.uint8]]:
    """Grey photographs of a kitchen, evenly out of the whole film."""
    paths = sorted((data_folder() / "kitchen").glob("*.jpg"))
    chosen = paths[:: len(paths) // count][:count]
    return [np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), np.uint8) for path in chosen]


def machine() -> str:
    """Processor, cores that may be used, and Python, for the caption of a table."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    model = next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), "")
    cores = len(os.sched_getaffinity(0))
    return f"{model or platform.machine()}, {cores} cores, Python {platform.python_version()}"


def show(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table; the first column is text, the others numbers."""
    table = Table(title=title, caption=machine(), title_justify="left")
    for index, column in enumerate(columns):
        table.add_column(column, justify="left" if index == 0 else "right", no_wrap=True)
    for row in rows:
        table.add_row(*row)
    Console(width=160).print(table)
