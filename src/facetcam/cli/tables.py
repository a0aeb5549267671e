"""Small tables for the terminal."""

from __future__ import annotations

from collections.abc import Sequence

from rich import box
from rich.console import Console
from rich.table import Table


def print_pairs(title: str, rows: Sequence[tuple[str, str]]) -> None:
    """Print names and values; long values, such as paths, are not cut."""
    table = Table(title=title, box=box.SIMPLE, show_header=False, title_justify="left")
    table.add_column()
    table.add_column(no_wrap=True, overflow="ignore")
    for name, value in rows:
        table.add_row(name, value)
    Console(soft_wrap=True, highlight=False).print(table)
