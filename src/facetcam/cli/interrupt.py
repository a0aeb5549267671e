"""Ctrl-C and SIGTERM: between two frames instead of amid one, or at once where nothing is lost by it."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Stopped(KeyboardInterrupt):
    """The user asked to stop; raised where the run can keep its results."""

    def __init__(self, signal_number: int) -> None:
        super().__init__()
        self.exit_code = 128 + signal_number


@contextmanager
def stoppable() -> Iterator[Callable[[], None]]:
    """Hold the first signal back until the given function is called; a second one strikes at once."""
    asked: list[int] = []

    def ask(number: int, _: FrameType | None) -> None:
        if asked:
            raise Stopped(number)
        asked.append(number)

    def stop_if_asked() -> None:
        if asked:
            raise Stopped(asked[0])
        listen()  # a native library loaded meanwhile may have taken SIGTERM (the logging of pycolmap does)

    def listen() -> None:
        for number in SIGNALS:
            signal.signal(number, ask)

    with _handlers_kept():
        listen()
        yield stop_if_asked


@contextmanager
def stopped_at_once() -> Iterator[None]:
    """Let a signal strike wherever the block is, for steps that take long and write nothing."""

    def stop(number: int, _: FrameType | None) -> None:
        raise Stopped(number)

    with _handlers_kept():
        for number in SIGNALS:
            signal.signal(number, stop)
        yield


@contextmanager
def _handlers_kept() -> Iterator[None]:
    """After the block, signals are handled as before."""
    before = {number: signal.getsignal(number) for number in SIGNALS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
