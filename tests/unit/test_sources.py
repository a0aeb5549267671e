"""Folders, films and cameras: what comes out, and what is said of bad ones."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from films import moving, textured, write_film, write_folder

from facetcam.errors import ConfigError, FacetcamError, SourceError
from facetcam.io.live import LiveCamera
from facetcam.io.sources import open_source


def times_of(path: Path, **options: float) -> list[float]:
    with open_source(path, **options) as source:
        return [frame.timestamp for frame in source]


class TestFolder:
    def test_natural_order_and_exact_pixels(self, tmp_path: Path) -> None:
        images = moving(12)
        folder = write_folder(tmp_path / "in", images)
        with open_source(folder, fps=10) as source:
            frames = list(source)
        assert [frame.name for frame in frames] == [f"{k}.png" for k in range(12)]
        assert all(np.array_equal(frame.image, image) for frame, image in zip(frames, images, strict=True))
        assert [frame.timestamp for frame in frames] == pytest.approx([k / 10 for k in range(12)])
        assert (source.size, source.count, source.time_span) == ((64, 48), 12, (0.0, 1.1))

    def test_times_by_name_or_by_order(self, tmp_path: Path) -> None:
        folder = write_folder(tmp_path / "in", moving(3), times=[0.5, 0.75, 2.0])
        assert times_of(folder) == [0.5, 0.75, 2.0]
        (folder / "timestamps.txt").write_text("1\n2\n4.5\n")
        assert times_of(folder) == [1.0, 2.0, 4.5]
        assert times_of(folder, fps=2) == [0.0, 0.5, 1.0]

    @pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
    @pytest.mark.parametrize("channels", [1, 3])
    def test_depth_and_colour_stay(self, tmp_path: Path, dtype: type, channels: int) -> None:
        rng = np.random.default_rng(1)
        image = rng.integers(0, np.iinfo(dtype).max, (20, 30, channels), dtype=dtype).squeeze()
        folder = write_folder(tmp_path / "in", [image])
        with open_source(folder, fps=1) as source:
            (frame,) = source
        assert frame.image.dtype == dtype
        assert np.array_equal(frame.image, image)

    def test_an_exif_turn_is_ignored(self, tmp_path: Path) -> None:
        folder = tmp_path / "in"
        folder.mkdir()
        jpeg = cv2.imencode(".jpg", textured(20, 30))[1].tobytes()
        tiff = (
            b"II*\x00\x08\x00\x00\x00\x01\x00\x12\x01\x03\x00\x01\x00\x00\x00\x06\x00\x00\x00\x00\x00\x00\x00"
        )
        exif = b"Exif\x00\x00" + tiff
        turned = jpeg[:2] + b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif + jpeg[2:]
        (folder / "a.jpg").write_bytes(turned)
        assert cv2.imread(str(folder / "a.jpg")).shape == (30, 20, 3)  # the tag does say a quarter turn
        with open_source(folder, fps=1) as source:
            assert source.size == (30, 20)

    def test_unreadable_images_are_skipped_counted_and_said(self, tmp_path: Path) -> None:
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

    def test_a_cut_off_jpeg_is_not_half_grey(self, tmp_path: Path) -> None:
        folder = write_folder(tmp_path / "in", moving(1))
        jpeg = cv2.imencode(".jpg", textured())[1].tobytes()
        (folder / "1.jpg").write_bytes(jpeg[: len(jpeg) * 2 // 3])
        with open_source(folder, fps=10) as source:
            assert len(list(source)) == 1
        assert source.skipped[0].name == "1.jpg"

    def test_one_image_is_a_source(self, tmp_path: Path) -> None:
        folder = write_folder(tmp_path / "in", moving(2))
        with open_source(folder / "1.png") as source:
            assert [frame.name for frame in source] == ["1.png"]

    def test_without_need_of_times_none_are_asked_for(self, tmp_path: Path) -> None:
        folder = write_folder(tmp_path / "in", moving(2))
        with open_source(folder, timed=False) as source:
            assert len(list(source)) == 2

    def test_sizes_that_differ_are_an_error_at_that_image(self, tmp_path: Path) -> None:
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
            ("0.png 1\n9.png 2\n2.png 3\n", "line 2: names 9.png, which is not in the folder"),
            ("0.png 1 2\n", "line 1: expected 'file seconds', got '0.png 1 2'"),
            ("", "0 times for 3 images"),
        ],
    )
    def test_bad_times_are_named(self, tmp_path: Path, table: str, message: str) -> None:
        folder = write_folder(tmp_path / "in", moving(3))
        (folder / "timestamps.txt").write_text(table)
        with pytest.raises(SourceError, match=rf"timestamps\.txt.*{message}"):
            open_source(folder)

    def test_no_times_no_images_no_readable_image(self, tmp_path: Path) -> None:
        folder = write_folder(tmp_path / "in", moving(1))
        with pytest.raises(SourceError, match=r"give --fps or write timestamps\.txt"):
            open_source(folder)
        (folder / "0.png").write_text("not an image")
        with pytest.raises(SourceError, match=r"none of 1 images can be read \(0\.png"):
            open_source(folder, fps=10)
        (folder / "0.png").unlink()
        with pytest.raises(SourceError, match="no images in this folder"):
            open_source(folder, fps=10)

    def test_float_images_are_refused(self, tmp_path: Path) -> None:
        folder = tmp_path / "in"
        folder.mkdir()
        cv2.imwrite(str(folder / "a.tiff"), np.ones((20, 30), np.float32))
        with pytest.raises(SourceError, match="float32, not 8 or 16 bit"):
            open_source(folder, fps=10)


class TestVideo:
    def test_frames_at_their_times(self, tmp_path: Path) -> None:
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

    def test_uneven_times_are_kept_and_replaced_on_request(self, tmp_path: Path) -> None:
        film = write_film(tmp_path / "a.mkv", moving(4), codec="ffv1", times=[0, 1, 5, 6])
        assert times_of(film) == pytest.approx([0.0, 0.1, 0.5, 0.6])
        assert times_of(film, fps=4) == [0.0, 0.25, 0.5, 0.75]

    def test_grey_and_sixteen_bit_stay(self, tmp_path: Path) -> None:
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
        self, tmp_path: Path, name: str, codec: str, options: dict[str, str]
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
    def test_no_film(self, tmp_path: Path, content: bytes | None, message: str) -> None:
        film = tmp_path / "film.mp4"
        if content is not None:
            film.write_bytes(content)
        with pytest.raises(SourceError, match=message) as caught:
            open_source(film)
        assert str(film) in str(caught.value)
        assert "\n" not in str(caught.value)

    def test_text_is_not_played_as_a_film(self, tmp_path: Path) -> None:
        (tmp_path / "notes.txt").write_text("FFmpeg would make pictures of this\n" * 50)
        with pytest.raises(SourceError, match="holds no film"):
            open_source(tmp_path / "notes.txt")

    def test_sound_alone_is_no_film(self, tmp_path: Path) -> None:
        header = b"RIFF" + (36 + 800).to_bytes(4, "little") + b"WAVEfmt " + (16).to_bytes(4, "little")
        form = b"\x01\x00\x01\x00\x40\x1f\x00\x00\x80\x3e\x00\x00\x02\x00\x10\x00"
        (tmp_path / "a.wav").write_bytes(header + form + b"data" + (800).to_bytes(4, "little") + bytes(800))
        with pytest.raises(SourceError, match="holds no film"):
            open_source(tmp_path / "a.wav")

    def test_cut_before_its_first_frame(self, tmp_path: Path) -> None:
        film = write_film(tmp_path / "a.mp4", moving(30), options={"movflags": "faststart"})
        data = film.read_bytes()
        film.write_bytes(data[: data.index(b"mdat") + 30])
        with pytest.raises(SourceError, match="no frame can be decoded"):
            open_source(film)

    def test_times_that_do_not_increase(self, tmp_path: Path) -> None:
        film = write_film(tmp_path / "a.avi", moving(30))  # AVI cannot hold the order of H.264's frames
        with open_source(film) as source, pytest.raises(SourceError, match=r"frame \d is at .* give --fps"):
            list(source)
        assert times_of(film, fps=10)[-1] == pytest.approx(2.9)

    def test_the_real_film(self, shared_data: Path) -> None:
        with open_source(shared_data / "house" / "loop.mp4") as source:
            assert (source.size, source.count) == ((1600, 1200), 307)
            for frame in source:
                assert frame.timestamp == pytest.approx(frame.index / 10, abs=1e-9)
                if frame.index == 9:
                    break


class FakeCapture:
    """Stands for `cv2.VideoCapture`: a camera that is unplugged after some images."""

    def __init__(self, images: int) -> None:
        self.left = images
        self.released = False

    def read(self) -> tuple[bool, np.ndarray | None]:
        self.left -= 1
        return (True, np.zeros((4, 6, 3), np.uint8)) if self.left >= 0 else (False, None)

    def release(self) -> None:
        self.released = True


class TestLive:
    def test_frames_until_it_is_unplugged(self, monkeypatch: pytest.MonkeyPatch) -> None:
        capture = FakeCapture(4)
        monkeypatch.setattr(cv2, "VideoCapture", lambda index: capture)
        camera = LiveCamera(0)
        frames: Iterator = iter(camera)
        times = [next(frames).timestamp for _ in range(3)]
        assert camera.size == (6, 4)
        assert times[0] == 0.0
        assert times == sorted(times)
        with pytest.raises(SourceError, match="unplugged"):
            next(frames)
        assert capture.released

    def test_no_such_camera(self) -> None:
        with pytest.raises(SourceError, match="camera 97: no such camera"):
            open_source("97")


@pytest.mark.parametrize("fps", [0.0, -1.0, float("nan"), float("inf")])
def test_a_frame_rate_is_positive(tmp_path: Path, fps: float) -> None:
    with pytest.raises(ConfigError, match="--fps"):
        open_source(tmp_path, fps)


def test_errors_are_of_the_family() -> None:
    assert issubclass(SourceError, FacetcamError)
