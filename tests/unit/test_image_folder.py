"""Folders of images: what comes out, and what is said of bad ones."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from films import moving, textured, write_folder

from facetcam.errors import SourceError
from facetcam.io.sources import open_source


def times_of(path: Path, **options: float) -> list[float]:
    with open_source(path, **options) as source:
        return [frame.timestamp for frame in source]


def test_natural_order_and_exact_pixels(tmp_path: Path) -> None:
    images = moving(12)
    folder = write_folder(tmp_path / "in", images)
    with open_source(folder, fps=10) as source:
        frames = list(source)
    assert [frame.name for frame in frames] == [f"{k}.png" for k in range(12)]
    assert all(np.array_equal(frame.image, image) for frame, image in zip(frames, images, strict=True))
    assert [frame.timestamp for frame in frames] == pytest.approx([k / 10 for k in range(12)])
    assert (source.size, source.count, source.time_span) == ((64, 48), 12, (0.0, 1.1))


def test_times_by_name_or_by_order(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "in", moving(3), times=[0.5, 0.75, 2.0])
    assert times_of(folder) == [0.5, 0.75, 2.0]
    (folder / "timestamps.txt").write_text("1\n2\n4.5\n")
    assert times_of(folder) == [1.0, 2.0, 4.5]
    assert times_of(folder, fps=2) == [0.0, 0.5, 1.0]


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("channels", [1, 3])
def test_depth_and_colour_stay(tmp_path: Path, dtype: type, channels: int) -> None:
    rng = np.random.default_rng(1)
    image = rng.integers(0, np.iinfo(dtype).max, (20, 30, channels), dtype=dtype).squeeze()
    folder = write_folder(tmp_path / "in", [image])
    with open_source(folder, fps=1) as source:
        (frame,) = source
    assert frame.image.dtype == dtype
    assert np.array_equal(frame.image, image)


def test_an_exif_turn_is_ignored(tmp_path: Path) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    jpeg = cv2.imencode(".jpg", textured(20, 30))[1].tobytes()
    tiff = b"II*\x00\x08\x00\x00\x00\x01\x00\x12\x01\x03\x00\x01\x00\x00\x00\x06\x00\x00\x00\x00\x00\x00\x00"
    exif = b"Exif\x00\x00" + tiff
    turned = jpeg[:2] + b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif + jpeg[2:]
    (folder / "a.jpg").write_bytes(turned)
    assert cv2.imread(str(folder / "a.jpg")).shape == (30, 20, 3)  # the tag does say a quarter turn
    with open_source(folder, fps=1) as source:
        assert source.size == (30, 20)


def test_unreadable_images_are_skipped_counted_and_said(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "in", moving(6))
    (folder / "0.png").write_bytes(b"")
    png = (folder / "3.png").read_bytes()
    (folder / "3.png").write_bytes(png[: len(png) // 2])
    with open_source(folder, fps=10) as source:
        frames = list(source)
    assert [frame.index for frame in frames] == [1, 2, 4, 5]
    assert frames[2].timestamp == pytest.approx(0.4)  # the others keep their times
    assert [item.name for item in source.skipped] == ["0.png", "3.png"]
    assert source.warnings == ("0.png skipped: empty file", "3.png skipped: damaged or not an image")


def test_a_cut_off_jpeg_is_not_half_grey(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "in", moving(1))
    jpeg = cv2.imencode(".jpg", textured())[1].tobytes()
    (folder / "1.jpg").write_bytes(jpeg[: len(jpeg) * 2 // 3])
    with open_source(folder, fps=10) as source:
        assert len(list(source)) == 1
    assert source.skipped[0].name == "1.jpg"


def test_hidden_files_are_no_images(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "in", moving(2), times=[0.0, 0.1])
    (folder / "._1.png").write_bytes(b"what some file systems leave")
    assert times_of(folder) == [0.0, 0.1]


def test_one_image_is_a_source(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "in", moving(2))
    with open_source(folder / "1.png") as source:
        assert [frame.name for frame in source] == ["1.png"]


def test_without_need_of_times_none_are_asked_for(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "in", moving(2))
    with open_source(folder, timed=False) as source:
        assert len(list(source)) == 2


def test_sizes_that_differ_are_an_error_at_that_image(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "in", [*moving(3), textured(20, 30)])
    with open_source(folder, fps=10) as source, pytest.raises(SourceError, match=r"3\.png: 30x20.*64x48"):
        list(source)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("0.png 1\n1.png 3\n2.png 2\n", r"times must increase, but 2 s \(row 3\) follows 3 s"),
        ("0.png 1\n1.png 1\n2.png 2\n", "times must increase"),
        ("0.png 1\n1.png 2\n", "2 times for 3 images"),
        ("1\n2\n3\n4\n", "4 times for 3 images"),
        ("0.png 1\n1.png now\n2.png 2\n", "line 2: 'now' is not a number"),
        ("0.png 1\n1.png nan\n2.png 2\n", "time 2 is not finite"),
        ("0.png 1403636579763555584\n1.png 1403636579813555456\n2.png 1403636579863555584\n", "in seconds"),
        ("0.png 1\n9.png 2\n2.png 3\n", "line 2: names 9.png, which is not in the folder"),
        ("0.png 1 2\n", "line 1: expected 'file seconds', got '0.png 1 2'"),
        ("", "0 times for 3 images"),
    ],
)
def test_bad_times_are_named(tmp_path: Path, table: str, message: str) -> None:
    folder = write_folder(tmp_path / "in", moving(3))
    (folder / "timestamps.txt").write_text(table)
    with pytest.raises(SourceError, match=rf"timestamps\.txt.*{message}"):
        open_source(folder)


def test_no_times_no_images_no_readable_image(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "in", moving(1))
    with pytest.raises(SourceError, match=r"give --fps or write timestamps\.txt"):
        open_source(folder)
    (folder / "0.png").write_text("not an image")
    with pytest.raises(SourceError, match=r"none of 1 images can be read \(0\.png"):
        open_source(folder, fps=10)
    (folder / "0.png").unlink()
    with pytest.raises(SourceError, match="no images in this folder"):
        open_source(folder, fps=10)


def test_float_images_are_refused(tmp_path: Path) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    cv2.imwrite(str(folder / "a.tiff"), np.ones((20, 30), np.float32))
    with pytest.raises(SourceError, match="float32, not 8 or 16 bit"):
        open_source(folder, fps=10)
