"""Small parts of the pipelines."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from facetcam.errors import OutputError
from facetcam.io.frames import Frame
from facetcam.pipelines.pictures import EvenSample
from facetcam.pipelines.progress import keeping, total_frames
from facetcam.pipelines.slam import when_due
from facetcam.pipelines.slam_record import SlamRecord
from facetcam.pipelines.slam_results import drop_warning
from facetcam.pipelines.summary import to_json
from facetcam.slam import State, Status


@pytest.mark.parametrize("count", [0, 1, 3, 4, 9, 100, 1000])
def test_a_sample_is_even_small_and_reaches_from_end_to_end(count: int) -> None:
    sample: EvenSample[int] = EvenSample(4)
    made: list[int] = []
    for k in range(count):
        sample.offer(lambda k=k: made.append(k) or k)
    items = sample.items()
    assert len(items) == min(4, count)
    assert len(made) <= 4 * max(count, 1).bit_length() + 8  # what is passed over is never made
    if count >= 4:
        steps = [b - a for a, b in pairwise(items)]
        assert items[0] == 0
        assert items[-1] >= 0.7 * (count - 1)
        assert max(steps) <= 2 * min(steps)


@pytest.mark.parametrize(
    ("count", "limit", "total"), [(None, None, None), (5, None, 5), (None, 3, 3), (5, 3, 3), (5, 9, 5)]
)
def test_how_many_frames_will_come(count: int | None, limit: int | None, total: int | None) -> None:
    assert total_frames(count, limit) == total


@dataclass
class Numbers:
    known: float
    unknown: float
    places: tuple[Path, ...]


def test_json_has_null_for_what_is_not_finite() -> None:
    text = to_json(Numbers(1.5, float("inf"), (Path("a"),)))
    assert json.loads(text) == {"known": 1.5, "unknown": None, "places": ["a"]}


def test_the_first_error_is_told_even_if_finishing_fails_too(tmp_path: Path) -> None:
    def finish(reason: str) -> None:
        raise OutputError(f"cannot say that {reason}")

    with pytest.raises(ZeroDivisionError) as caught, keeping(tmp_path, finish):
        raise ZeroDivisionError("first")
    assert caught.value.__notes__ == [f"the results so far are in {tmp_path}"]


def test_the_reason_is_given() -> None:
    reasons: list[str] = []
    for error in (KeyboardInterrupt(), OutputError("disk full"), ValueError("odd")):
        with pytest.raises(type(error)), keeping(Path("out"), reasons.append):
            raise error
    assert reasons == ["stopped by the user", "disk full", "ValueError: odd"]


def test_frames_come_when_they_are_due_and_late_ones_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a clock that sleeping alone moves, but for one frame whose use takes 0.35 s."""
    now = [100.0]
    monkeypatch.setattr(time, "perf_counter", lambda: now[0])
    monkeypatch.setattr(time, "sleep", lambda seconds: now.__setitem__(0, now[0] + seconds))
    frames = [Frame(k, 7.0 + 0.1 * k, np.zeros((2, 2), np.uint8), str(k)) for k in range(7)]
    came = []
    for frame in when_due(frames):
        came.append(round(now[0] - 100.0, 6))
        now[0] += 0.35 if frame.index == 1 else 0.0
    assert came == [0.0, 0.1, 0.45, 0.45, 0.45, 0.5, 0.6]


@pytest.mark.parametrize(
    ("dropped", "live", "line"),
    [
        (0, False, []),
        (3, False, ["3 of 10 frames were dropped to keep up with real time"]),
        (3, True, ["8 of 15 frames were dropped to keep up with real time"]),
    ],
)
def test_frames_left_out_are_told(dropped: int, live: bool, line: list[str], tmp_path: Path) -> None:
    """Ten frames of a source, five missing amid them: a folder may have such gaps, a camera drops."""
    with SlamRecord(tmp_path, ("front",)) as record:
        for index in [*range(4), *range(9, 15)]:
            frame = Frame(index, 0.1 * index, np.zeros((2, 2), np.uint8), str(index))
            record.add(frame, State(frame.timestamp, Status.STARTING))
    assert drop_warning(record, dropped, live) == line
