"""Films: what comes out, and what is said of bad ones."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from films import moving, write_film

from facetcam.errors import SourceError
from facetcam.io.sources import open_source


def times_of(path: Path, **options: float) -> list[float]:
    with open_source(path, **options) as source:
        return [frame.timestamp for frame in source]


def test_frames_at_their_times(tmp_path: Path) -> None:
    images = moving(20)
    film = write_film(tmp_path / "a.mp4", images)
    with open_source(film) as source:
        frames = list(source)
    assert (source.size, source.count, len(frames)) == ((64, 48), 20, 20)
    assert source.time_span == pytest.approx((0.0, 1.9))
    assert [frame.timestamp for frame in frames] == pytest.approx([k / 10 for k in range(20)])
    errors = [np.abs(f.image.astype(int) - i).mean() for f, i in zip(frames, images, strict=True)]
    assert max(errors) < 12  # lossy, but each its own picture: the next one is further away
    assert np.abs(frames[0].image.astype(int) - images[5]).mean() > 30
    assert source.skipped == ()


def test_uneven_times_are_kept_and_replaced_on_request(tmp_path: Path) -> None:
    film = write_film(tmp_path / "a.mkv", moving(4), codec="ffv1", times=[0, 1, 5, 6])
    assert times_of(film) == pytest.approx([0.0, 0.1, 0.5, 0.6])
    assert times_of(film, fps=4) == [0.0, 0.25, 0.5, 0.75]


def test_grey_and_sixteen_bit_stay(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    grey = [rng.integers(0, 256, (48, 64), dtype=np.uint8) for _ in range(3)]
    film = write_film(tmp_path / "g.mkv", grey, codec="ffv1", pixels="gray", source="gray")
    with open_source(film) as source:
        assert all(np.array_equal(frame.image, image) for frame, image in zip(source, grey, strict=True))
    deep = [rng.integers(0, 65536, (48, 64), dtype=np.uint16) for _ in range(3)]
    film = write_film(tmp_path / "d.mkv", deep, codec="ffv1", pixels="gray16le", source="gray16le")
    with open_source(film) as source:
        assert all(np.array_equal(frame.image, image) for frame, image in zip(source, deep, strict=True))


@pytest.mark.parametrize(
    ("name", "codec", "options"),
    [("a.mp4", "libx264", {"movflags": "faststart"}), ("a.mkv", "libx264", {}), ("a.avi", "mpeg4", {})],
)
def test_a_cut_off_film_gives_its_frames_and_says_so(
    tmp_path: Path, name: str, codec: str, options: dict[str, str]
) -> None:
    rng = np.random.default_rng(3)
    noise = [rng.integers(0, 256, (48, 64, 3), dtype=np.uint8) for _ in range(30)]
    film = write_film(tmp_path / name, noise, codec=codec, options=options)
    with open_source(film) as source:
        whole = [frame.image for frame in source]
    data = film.read_bytes()
    film.write_bytes(data[: len(data) // 2])
    with open_source(film) as source:
        part = [frame.image for frame in source]
    assert 3 < len(part) < 30
    assert all(np.array_equal(a, b) for a, b in zip(part, whole))
    assert re.search(rf"frame {len(part)} and later skipped.*cut off or damaged", source.warnings[0])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "no such file or folder"),
        (b"", "empty file"),
        (b"This is no film.\n" * 20, "cannot be read as a film"),
        (b"\x00\x00\x00\x18ftypmp42" + bytes(200), "film"),
    ],
)
def test_no_film(tmp_path: Path, content: bytes | None, message: str) -> None:
    film = tmp_path / "film.mp4"
    if content is not None:
        film.write_bytes(content)
    with pytest.raises(SourceError, match=message) as caught:
        open_source(film)
    assert str(film) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_text_is_not_played_as_a_film(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("FFmpeg would make pictures of this\n" * 50)
    with pytest.raises(SourceError, match="holds no film"):
        open_source(tmp_path / "notes.txt")


def test_sound_alone_is_no_film(tmp_path: Path) -> None:
    header = b"RIFF" + (36 + 800).to_bytes(4, "little") + b"WAVEfmt " + (16).to_bytes(4, "little")
    form = b"\x01\x00\x01\x00\x40\x1f\x00\x00\x80\x3e\x00\x00\x02\x00\x10\x00"
    (tmp_path / "a.wav").write_bytes(header + form + b"data" + (800).to_bytes(4, "little") + bytes(800))
    with pytest.raises(SourceError, match="holds no film"):
        open_source(tmp_path / "a.wav")


def test_cut_before_its_first_frame(tmp_path: Path) -> None:
    film = write_film(tmp_path / "a.mp4", moving(30), options={"movflags": "faststart"})
    data = film.read_bytes()
    film.write_bytes(data[: data.index(b"mdat") + 30])
    with pytest.raises(SourceError, match="no frame can be decoded"):
        open_source(film)


def test_times_that_do_not_increase(tmp_path: Path) -> None:
    film = write_film(tmp_path / "a.avi", moving(30))  # AVI cannot hold the order of H.264's frames
    with open_source(film) as source, pytest.raises(SourceError, match=r"frame \d is at .* give --fps"):
        list(source)
    assert times_of(film, fps=10)[-1] == pytest.approx(2.9)


def test_the_real_film(shared_data: Path) -> None:
    with open_source(shared_data / "house" / "loop.mp4") as source:
        assert (source.size, source.count) == ((1600, 1200), 307)
        for frame in source:
            assert frame.timestamp == pytest.approx(frame.index / 10, abs=1e-9)
            if frame.index == 9:
                break
