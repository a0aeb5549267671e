"""A progress bar on stderr, with the time left, that also carries the wish to stop."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from facetcam.cli.interrupt import stoppable, stopped_at_once

Show = Callable[[int, int | None], None]


@contextmanager
def progress_bar(label: str) -> Iterator[Show]:
    """Show a bar (on a terminal only) for the pipeline's progress; Ctrl-C stops between two frames."""
    with stoppable() as stop_if_asked, _bar(label) as show:

        def advance(done: int, total: int | None) -> None:
            stop_if_asked()
            show(done, total)

        yield advance


@contextmanager
def prompt_bar(label: str) -> Iterator[Show]:
    """The same where Ctrl-C may stop at once, however long a step takes."""
    with stopped_at_once(), _bar(label) as show:
        yield show


@contextmanager
def _bar(label: str) -> Iterator[Show]:
    # Here, so that help is quick.
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(),
    )
    bar = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
    with bar:
        task = bar.add_task(label, total=None, rate="")

        def show(done: int, total: int | None) -> None:
            speed = bar.tasks[0].speed
            bar.update(task, completed=done, total=total, rate=f"{speed:.1f} frames/s" if speed else "")

        yield show
