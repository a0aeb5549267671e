"""A few of the many things that pass by, spread evenly, without knowing how many will come."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class EvenSample(Generic[T]):
    """Keeps between `wanted` and twice as many of the offered items, evenly spaced; forgets the others."""

    def __init__(self, wanted: int) -> None:
        self._wanted = wanted
        self._stride = 1
        self._offered = 0
        self._kept: list[T] = []

    def offer(self, make: Callable[[], T]) -> None:
        """Take or pass over the next item; `make` is called only for those taken."""
        if self._offered % self._stride == 0:
            if len(self._kept) == 2 * self._wanted:
                self._kept = self._kept[::2]
                self._stride *= 2
            if self._offered % self._stride == 0:
                self._kept.append(make())
        self._offered += 1

    def items(self) -> list[T]:
        """At most `wanted` items, from the first to the last one kept."""
        count = min(self._wanted, len(self._kept))
        last = len(self._kept) - 1
        return [self._kept[round(i * last / max(count - 1, 1))] for i in range(count)]
