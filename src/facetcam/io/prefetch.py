"""Pull the items of an iterator in a background thread, a few ahead of their use."""

from __future__ import annotations

import threading
from collections.abc import Generator, Iterable
from contextlib import suppress
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from typing import Generic, TypeVar

T = TypeVar("T")


def prefetch(items: Iterable[T], depth: int, latest_only: bool = False) -> Generator[T]:
    """Yield `items`, produced in a thread at most `depth` ahead.

    An exception of the producer is raised here, after the items before it. Leaving the loop early, or closing
    the generator, stops and joins the thread.

    Parameters
    ----------
    items : iterable
        Iterated in the thread only.
    depth : int
        Items that wait at most.
    latest_only : bool
        Drop waiting items for newer ones instead of making the producer wait: for live cameras.
    """
    channel: _Channel[T] = _Channel(depth, latest_only)
    thread = threading.Thread(target=channel.fill, args=(items,), name="facetcam-prefetch", daemon=True)
    thread.start()
    try:
        while isinstance(entry := channel.ready.get(), _Item):
            channel.room.release()
            yield entry.value
        if entry.error is not None:
            raise entry.error
    finally:
        channel.stopped.set()
        channel.room.release()  # wakes a producer that waits for room
        thread.join()


@dataclass(frozen=True, slots=True)
class _Item(Generic[T]):
    value: T


@dataclass(frozen=True, slots=True)
class _End:
    error: BaseException | None


class _Channel(Generic[T]):
    """What the two threads share."""

    def __init__(self, depth: int, latest_only: bool) -> None:
        self.depth = depth
        self.latest_only = latest_only
        self.ready: SimpleQueue[_Item[T] | _End] = SimpleQueue()
        self.room = threading.Semaphore(depth)
        self.stopped = threading.Event()

    def fill(self, items: Iterable[T]) -> None:
        """The thread's body: pass the items on, then say how it ended."""
        error: BaseException | None = None
        try:
            for item in items:
                self._make_room()
                if self.stopped.is_set():
                    break
                self.ready.put(_Item(item))
        except BaseException as caught:  # it belongs to the consumer, whatever it is
            error = caught
        self.ready.put(_End(error))

    def _make_room(self) -> None:
        if not self.latest_only:
            self.room.acquire()
            return
        with suppress(Empty):  # the consumer may have taken it first
            while self.ready.qsize() >= self.depth:
                self.ready.get_nowait()
