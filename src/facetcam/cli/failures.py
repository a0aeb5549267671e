"""How commands fail: one line on stderr that says what, where and what to do; never a traceback."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable
from contextvars import ContextVar
from typing import ParamSpec

import typer

from facetcam.cli.interrupt import Stopped
from facetcam.errors import FacetcamError

P = ParamSpec("P")

DEBUG: ContextVar[bool] = ContextVar("debug", default=False)
INTERRUPTED = 130  # 128 + SIGINT, as shells have it


def in_one_line(command: Callable[P, None]) -> Callable[P, None]:
    """Let a command end with an exit code and one line where it raises."""

    @functools.wraps(command)
    def guarded(*args: P.args, **kwargs: P.kwargs) -> None:
        try:
            command(*args, **kwargs)
        except (typer.Exit, typer.BadParameter):
            raise
        except KeyboardInterrupt as error:
            code = error.exit_code if isinstance(error, Stopped) else INTERRUPTED
            raise failed("stopped", error, code) from None
        except FacetcamError as error:
            raise failed(f"error: {error}", error) from None
        except OSError as error:
            where = f"{error.filename}: " if error.filename else ""
            raise failed(f"error: {where}{error.strerror or error}", error) from None
        except Exception as error:
            if DEBUG.get():
                raise
            what = f"{type(error).__name__}: {error}"
            hint = "run `facetcam --debug ...` again and report what it shows"
            raise failed(f"error: unexpected failure ({what}); {hint}", error) from None

    return guarded


def failed(message: str, error: BaseException, code: int = 1) -> typer.Exit:
    """Say the message and the error's notes, and give the exit to raise."""
    notes = getattr(error, "__notes__", [])
    say("; ".join([message, *notes]))
    return typer.Exit(code)


def warn(message: str) -> None:
    """Say what was not as it should be, on one line."""
    say(f"warning: {message}")


def say(message: str) -> None:
    print(f"facetcam: {' '.join(message.split())}", file=sys.stderr)
