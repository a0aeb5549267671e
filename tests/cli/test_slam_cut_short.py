"""`facetcam slam` that ends early: what is there stays, and the run says how it ended."""

from __future__ import annotations

import json
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import cv2
import fake_slam
import pytest
from command import Facetcam, only_line
from fake_slam import FakeSlam
from films import FakeCapture, moving, textured, write_film, write_folder

import facetcam.pipelines.slam
import facetcam.pipelines.slam_results as facetcam_results
from facetcam.errors import OutputError
from facetcam.io.outputs import LineWriter
from facetcam.io.trajectories import read_tum


@pytest.fixture(autouse=True)
def fake(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(facetcam.pipelines.slam, "Slam", FakeSlam)


def test_an_image_of_another_size_amid_the_film(facetcam: Facetcam, rig: Path, tmp_path: Path) -> None:
    folder, out = write_folder(tmp_path / "in", [*moving(6), textured(20, 30)]), tmp_path / "out"
    line = only_line(facetcam("slam", folder, "--rig", rig, "--fps", 10, "--out", out))
    assert "6.png: 30x20" in line
    assert f"the results so far are in {out}" in line
    assert len(read_tum(out / "trajectory.tum")[0]) == 6
    assert "6.png: 30x20" in json.loads((out / "summary.json").read_text())["interrupted"]
    assert "Interrupted" in (out / "report.html").read_text()


def test_a_camera_that_is_unplugged(
    facetcam: Facetcam, rig: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cv2, "VideoCapture", lambda index: FakeCapture(30))
    out = tmp_path / "out"
    line = only_line(facetcam("slam", "97", "--rig", rig, "--out", out))
    assert "camera 97: stopped delivering images; was it unplugged?" in line
    assert 0 < json.loads((out / "summary.json").read_text())["frames"] < 30


def test_a_full_disk(
    facetcam: Facetcam, film: Path, rig: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write, written = LineWriter.write, []

    def until_full(self: LineWriter, line: str) -> None:
        written.append(line)
        if len(written) > 20:
            raise OutputError(f"{self.path}: cannot be written (No space left on device)")
        write(self, line)

    monkeypatch.setattr(LineWriter, "write", until_full)
    out = tmp_path / "out"
    line = only_line(facetcam("slam", film, "--rig", rig, "--out", out))
    assert "No space left on device" in line
    assert len((out / "states.csv").read_text().splitlines()) > 5
    assert "No space left" in json.loads((out / "summary.json").read_text())["interrupted"]


def test_a_result_that_cannot_be_written_costs_no_other(
    facetcam: Facetcam, film: Path, rig: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(path: Path, *_: object) -> None:
        raise OutputError(f"{path}: cannot be written (No space left on device)")

    monkeypatch.setattr(facetcam_results, "write_ply", full)
    out = tmp_path / "out"
    line = only_line(facetcam("slam", film, "--rig", rig, "--out", out))
    assert "map.ply: cannot be written (No space left on device); the results so far are in" in line
    assert "map.ply" in json.loads((out / "summary.json").read_text())["interrupted"]
    assert "Interrupted" in (out / "report.html").read_text()
    assert (out / "colmap" / "images.bin").exists()
    assert len(read_tum(out / "trajectory.tum")[0]) == 20


def test_a_failure_of_our_own(
    facetcam: Facetcam, film: Path, rig: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(self: FakeSlam) -> None:
        raise ZeroDivisionError("division by zero")

    monkeypatch.setattr(FakeSlam, "finish", broken)
    out = tmp_path / "out"
    line = only_line(facetcam("slam", film, "--rig", rig, "--out", out))
    assert "unexpected failure (ZeroDivisionError: division by zero); run `facetcam --debug" in line
    assert len(read_tum(out / "trajectory.tum")[0]) == 20
    debugged = facetcam("--debug", "slam", film, "--rig", rig, "--out", tmp_path / "again")
    assert isinstance(debugged.exception, ZeroDivisionError)


def start(tmp_path: Path, rig: Path, **options: object) -> subprocess.Popen[str]:
    """The command as a process of its own: 400 frames, one every 20 ms."""
    film = write_film(tmp_path / "long.mp4", moving(400))
    command = [sys.executable, fake_slam.__file__, "slam", film, "--rig", rig, "--out", tmp_path / "out"]
    words = [str(word) for word in command]
    return subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options)


def wait_for_lines(path: Path, count: int) -> None:
    for _ in range(600):
        if path.exists() and len(path.read_text().splitlines()) >= count:
            return
        time.sleep(0.05)
    pytest.fail(f"{path} never had {count} lines")


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_stop(rig: Path, tmp_path: Path, number: int, code: int) -> None:
    out = tmp_path / "out"
    with start(tmp_path, rig) as process:
        wait_for_lines(out / "states.csv", 12)
        process.send_signal(number)
        _, stderr = process.communicate(timeout=60)
    assert process.returncode == code
    assert stderr == f"facetcam: stopped; the results so far are in {out}\n"
    summary = json.loads((out / "summary.json").read_text())
    assert summary["interrupted"] == "stopped by the user"
    assert 11 <= summary["frames"] < 400
    assert len(read_tum(out / "trajectory.tum")[0]) == summary["frames"]
    assert (out / "report.html").exists()


def test_kill(rig: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    with start(tmp_path, rig) as process:
        wait_for_lines(out / "states.csv", 12)
        process.kill()
        process.communicate(timeout=60)
    times, _ = read_tum(out / "trajectory.tum")
    rows = (out / "states.csv").read_text().splitlines()[1:]
    assert len(rows) - 3 <= len(times) <= len(rows)  # two frames had no pose yet, one may be between
    assert len(times) >= 8


def test_a_limit_of_the_system_on_what_is_written(rig: Path, tmp_path: Path) -> None:
    out, limit = tmp_path / "out", 4096
    with start(
        tmp_path, rig, preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
    ) as process:
        _, stderr = process.communicate(timeout=60)
    assert process.returncode == 1
    assert len(stderr.splitlines()) == 1
    assert "cannot be written (File too large); the results so far are in" in stderr
    assert len((out / "states.csv").read_text().splitlines()) > 10
    assert (out / "states.csv").stat().st_size <= limit
