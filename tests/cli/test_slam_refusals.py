"""`facetcam slam` with bad input: one line, exit code 1, no folder made, nothing written over."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from command import Facetcam, only_line
from films import moving, textured, write_film, write_folder

Refused = Callable[..., str]


@pytest.fixture
def refused(facetcam: Facetcam, rig: Path, tmp_path: Path) -> Refused:
    """Run `facetcam slam` with arguments and return its complaint."""

    def run(*arguments: object) -> str:
        line = only_line(facetcam("slam", *arguments, "--rig", rig, "--out", tmp_path / "out"))
        assert not (tmp_path / "out").exists()
        return line

    return run


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "no such file or folder"),
        (b"", "empty file"),
        (b"no film\n" * 50, "cannot be read as a film"),
    ],
)
def test_no_film(refused: Refused, tmp_path: Path, content: bytes | None, message: str) -> None:
    if content is not None:
        (tmp_path / "bad.mp4").write_bytes(content)
    assert message in refused(tmp_path / "bad.mp4")


def test_an_empty_folder(refused: Refused, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    assert "no images" in refused(tmp_path / "empty")


def test_images_without_times(refused: Refused, tmp_path: Path) -> None:
    assert "give --fps" in refused(write_folder(tmp_path / "in", moving(2)))


def test_times_that_do_not_increase(refused: Refused, tmp_path: Path) -> None:
    assert "times must increase" in refused(write_folder(tmp_path / "in", moving(3), times=[0.0, 0.2, 0.1]))


def test_a_film_of_another_size(refused: Refused, tmp_path: Path) -> None:
    film = write_film(tmp_path / "big.mp4", [textured(96, 128)] * 3)
    assert "frames are 128x96, but the rig's camera is 64x48" in refused(film)


def test_a_frame_rate_of_nothing(refused: Refused, film: Path) -> None:
    assert "--fps 0.0" in refused(film, "--fps", 0)


def test_a_missing_rig(refused: Refused, film: Path, rig: Path) -> None:
    rig.unlink()
    assert "rig.yaml" in refused(film)


def test_a_rig_with_an_unknown_key(refused: Refused, film: Path, rig: Path) -> None:
    rig.write_text(rig.read_text().replace("distortion", "distorsion"))
    assert "did you mean 'distortion'?" in refused(film)


def test_a_camera_that_is_a_mirror_image(refused: Refused, film: Path, rig: Path) -> None:
    rig.write_text(rig.read_text().replace("[0, -1, 0, 0]", "[0, 1, 0, 0]"))
    assert "T_rig_cam" in refused(film)


def test_a_view_through_an_absent_mirror(refused: Refused, film: Path, rig: Path) -> None:
    rig.write_text(rig.read_text().replace("mirrors: []", "mirrors: [left]"))
    assert "no mirror 'left'" in refused(film)


def test_odometry_that_does_not_cover_the_film(refused: Refused, film: Path, tmp_path: Path) -> None:
    rows = [f"{t:.1f},0,0,0" for t in np.arange(16) / 10]
    (tmp_path / "odometry.csv").write_text("\n".join(["timestamp,x,y,yaw", *rows]))
    assert "covers 0.000 to 1.500 s" in refused(film, "--odometry", tmp_path / "odometry.csv")


def test_a_broken_truth(refused: Refused, film: Path, tmp_path: Path) -> None:
    (tmp_path / "truth.tum").write_text("0 0 0\n")
    assert "truth.tum line 1: expected 8 values" in refused(film, "--truth", tmp_path / "truth.tum")


def test_an_unknown_setting(refused: Refused, film: Path, tmp_path: Path) -> None:
    (tmp_path / "slam.yaml").write_text("windov: 5\n")
    line = refused(film, "--config", tmp_path / "slam.yaml")
    assert "slam.yaml: unknown key 'windov'; did you mean 'window'?" in line


def test_an_existing_folder_is_not_touched(facetcam: Facetcam, film: Path, rig: Path, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "trajectory.tum").write_text("precious")
    line = only_line(facetcam("slam", film, "--rig", rig, "--out", tmp_path / "out"))
    assert "exists already and is not written over" in line
    assert (tmp_path / "out" / "trajectory.tum").read_text() == "precious"
