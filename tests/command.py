"""How tests look at the command line."""

from __future__ import annotations

from collections.abc import Callable

from typer.testing import Result

Facetcam = Callable[..., Result]
"""Runs `facetcam` with arguments."""


def only_line(result: Result, code: int = 1) -> str:
    """The one line on stderr of a command that failed as it should."""
    assert result.exit_code == code, result.output
    lines = result.stderr.splitlines()
    assert len(lines) == 1, result.stderr
    assert lines[0].startswith("facetcam: error: ")
    return lines[0]
