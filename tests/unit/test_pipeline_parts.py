"""Small parts of the pipelines."""

from __future__ import annotations

import json
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import pytest

from facetcam.errors import OutputError
from facetcam.pipelines.pictures import EvenSample
from facetcam.pipelines.progress import keeping, total_frames
from facetcam.pipelines.summary import to_json


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
