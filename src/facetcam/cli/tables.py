"""Small tables for the terminal."""

from __future__ import annotations

from collections.abc import Sequence

UNBOUNDED = 10_000  # characters


def print_pairs(title: str, rows: Sequence[tuple[str, str]]) -> None:
    """Print names and values; long values, such as paths, are not cut."""
    # Here, so that help is quick.
    from rich import box
    from rich.console import Console
    from rich.table import Table

    table = Table(title=title, box=box.SIMPLE, show_header=False, title_justify="left")
    table.add_column()
    table.add_column()
    for name, value in rows:
        table.add_row(name, value)
    # Rich would squeeze columns into the terminal's width; a path that is cut is of no use.
    Console(width=UNBOUNDED, highlight=False).print(table)
