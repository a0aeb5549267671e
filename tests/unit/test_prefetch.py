"""Items come from a thread, in order, and the thread never outlives their use."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import pytest

from facetcam.io.prefetch import prefetch


def threads() -> list[str]:
    return [t.name for t in threading.enumerate() if t.name == "facetcam-prefetch"]


def test_all_items_in_order() -> None:
    assert list(prefetch(range(100), depth=3)) == list(range(100))
    assert threads() == []


def test_only_a_few_are_produced_ahead() -> None:
    produced: list[int] = []

    def items() -> Iterator[int]:
        for k in range(50):
            produced.append(k)
            yield k

    consumer = prefetch(items(), depth=2)
    assert next(consumer) == 0
    time.sleep(0.1)
    assert len(produced) <= 4  # one taken, two waiting, one in hand
    consumer.close()
    assert threads() == []


def test_leaving_early_stops_the_producer_and_closes_it() -> None:
    closed = threading.Event()

    def endless() -> Iterator[int]:
        try:
            k = 0
            while True:
                yield (k := k + 1)
        finally:
            closed.set()

    consumer = prefetch(endless(), depth=1)
    assert [next(consumer) for _ in range(3)] == [1, 2, 3]
    consumer.close()
    assert closed.is_set()
    assert threads() == []


def test_an_error_comes_after_the_items_before_it() -> None:
    def failing() -> Iterator[int]:
        yield 1
        raise ValueError("broken")

    consumer = prefetch(failing(), depth=3)
    assert next(consumer) == 1
    with pytest.raises(ValueError, match="broken"):
        next(consumer)
    assert threads() == []


def test_latest_only_skips_what_nobody_took() -> None:
    done = threading.Event()

    def camera() -> Iterator[int]:
        yield from range(100)
        done.set()

    consumer = prefetch(camera(), depth=2, latest_only=True)
    first = next(consumer)
    assert done.wait(5.0)  # the producer never waited for the consumer
    rest = list(consumer)
    assert first in (0, 98)  # 98 if the thread had finished before the first look
    assert rest[-1] == 99
    assert len(rest) <= 2
