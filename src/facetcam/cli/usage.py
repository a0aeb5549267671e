"""What is wrong with the words of a command, on one line like every other error."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import typer
from typer.core import TyperGroup

from facetcam.cli.failures import say

_UsageError: type[Any] = typer.BadParameter.__mro__[1]  # typer names it in no public place


class OneLineGroup(TyperGroup):
    """A group of commands that answers wrong usage with one line and its exit code."""

    def make_context(self, *args: Any, **extra: Any) -> Any:
        with usage_in_one_line():
            return super().make_context(*args, **extra)

    def invoke(self, ctx: Any) -> Any:
        with usage_in_one_line():
            return super().invoke(ctx)


@contextmanager
def usage_in_one_line() -> Iterator[None]:
    """Say a usage error and raise the exit; help that stands in for missing words is shown whole."""
    try:
        yield
    except _UsageError as error:
        if type(error).__name__ == "NoArgsIsHelpError":
            raise
        command = error.ctx.command_path if error.ctx is not None else "facetcam"
        say(f"error: {error.format_message().rstrip('.')}; see `{command} --help`")
        raise typer.Exit(error.exit_code) from None
