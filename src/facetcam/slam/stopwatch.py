"""What each stage costs."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager


class Stopwatch:
    """Seconds of each stage, call by call.

    Attributes
    ----------
    seconds : dict of str to list of float
    """

    def __init__(self) -> None:
        self.seconds: dict[str, list[float]] = defaultdict(list)

    @contextmanager
    def timed(self, stage: str) -> Iterator[None]:
        """Count what runs inside to a stage, unless it fails."""
        start = time.perf_counter()
        yield
        self.seconds[stage].append(time.perf_counter() - start)
