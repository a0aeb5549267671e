"""Films that are written come back as they were."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from facetcam.errors import OutputError
from facetcam.io import film_writer
from facetcam.io.film_writer import write_film
from facetcam.io.sources import open_source


def test_frames_come_back_in_order_at_their_times(tmp_path: Path) -> None:
    smooth = cv2.GaussianBlur(np.random.default_rng(0).integers(0, 255, (96, 128), np.uint8), (0, 0), 3)
    smooth = cv2.normalize(smooth, None, 20, 230, cv2.NORM_MINMAX)
    frames = [np.roll(cv2.cvtColor(smooth, cv2.COLOR_GRAY2BGR), 5 * k, axis=1) for k in range(12)]
    write_film(tmp_path / "film.mp4", frames, 8)
    with open_source(tmp_path / "film.mp4") as film:
        read = list(film)
    assert [frame.timestamp for frame in read] == pytest.approx([k / 8 for k in range(12)])
    written, found = np.array(frames, dtype=int), np.array([frame.image for frame in read], dtype=int)
    assert np.abs(found - written).mean() < 5.0  # FFmpeg's colour conversion alone costs 3
    assert np.abs(found[1:] - written[:-1]).mean() > 15.0


def test_a_film_does_not_depend_on_the_processor(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Plain C code of the encoder, which takes no short cuts of any processor, makes the same film."""
    noise = np.random.default_rng(0).integers(0, 255, (240, 320, 3), np.uint8)
    rough = cv2.GaussianBlur(noise, (0, 0), 1)
    frames = [np.roll(rough, 3 * k, axis=1) for k in range(24)]
    write_film(tmp_path / "film.mp4", frames, 10)
    monkeypatch.setitem(film_writer.QUALITY, "x264-params", "no-asm=1")
    write_film(tmp_path / "plain.mp4", frames, 10)
    film, plain = (list(open_source(tmp_path / name)) for name in ("film.mp4", "plain.mp4"))
    for a, b in zip(film, plain, strict=True):
        np.testing.assert_array_equal(a.image, b.image)


@pytest.mark.parametrize(("frames", "message"), [([], "no frame"), ([np.zeros((5, 4, 3), np.uint8)], "even")])
def test_what_is_no_film_is_refused(tmp_path: Path, frames: list[np.ndarray], message: str) -> None:
    with pytest.raises(OutputError, match=message):
        write_film(tmp_path / "film.mp4", frames, 10)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_missing_is_said(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="cannot be written"):
        write_film(tmp_path / "nowhere" / "film.mp4", [np.zeros((4, 4, 3), np.uint8)], 10)
