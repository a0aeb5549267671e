"""The page of a run: what it reads, what it says, and that a real browser shows it."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from facetcam.errors import SourceError
from facetcam.geometry import se3
from facetcam.io.ply import read_ply, write_ply
from facetcam.io.trajectories import write_tum
from facetcam.pipelines.view import open_run_page, read_run
from facetcam.viz.run_page import COLOURS, RunPage

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
RED = np.array([230, 20, 20], np.uint8)
TIMES = 5.0 + 0.1 * np.arange(40)
LOST = 3
CIRCLE = [se3.from_rotation_translation(np.eye(3), [np.cos(t), np.sin(t), 1.0]) for t in TIMES]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A run on a circle amid a red floor, whose last three frames are lost."""
    run = tmp_path / "run"
    run.mkdir()
    rows = [
        f"{t:.9f},{'LOST' if k >= len(TIMES) - LOST else 'TRACKING'},{int(k % 5 == 0)},{k},{k + 9}"
        for k, t in enumerate(TIMES)
    ]
    header = "timestamp,status,keyframe,front_inliers,front_predicted"
    (run / "states.csv").write_text("\n".join([header, *rows]) + "\n")
    write_tum(run / "trajectory.tum", TIMES[:-LOST], np.array(CIRCLE[:-LOST]))
    floor = np.array([(x, y, 0.0) for x in np.linspace(-2, 2, 60) for y in np.linspace(-2, 2, 60)])
    write_ply(run / "map.ply", floor, np.tile(RED, (len(floor), 1)))
    (run / "summary.json").write_text(json.dumps({"metric": True, "scale_sigma": 0.0123}))
    return run


def test_a_run_is_read_with_its_final_poses(folder: Path) -> None:
    run = read_run(folder)
    assert run.scale == "METRIC (± 1.2 %)"
    assert [m.time for m in run.moments] == pytest.approx(TIMES)
    for moment, T in zip(run.moments[:-LOST], CIRCLE):
        np.testing.assert_allclose(moment.T_world_rig, T, atol=1e-8)
    assert all(moment.T_world_rig is None for moment in run.moments[-LOST:])
    assert run.moments[10].keyframe and run.moments[10].seen == {"front": (10, 19)}
    assert len(run.points) == 3600 and (run.colours == RED).all()


def test_a_run_that_goes_on_is_shown_as_far_as_it_is(folder: Path) -> None:
    """No map and no summary yet, and the last line is being written."""
    (folder / "map.ply").unlink()
    (folder / "summary.json").unlink()
    with (folder / "states.csv").open("a") as file:
        file.write("9.1,TRACK")
    run = read_run(folder)
    assert run.scale.startswith("NOT METRIC")
    assert len(run.moments) == 40 and len(run.points) == 0


@pytest.mark.parametrize("name", ["states.csv", "trajectory.tum", "map.ply", "summary.json"])
def test_a_damaged_file_is_named(folder: Path, name: str) -> None:
    data = (folder / name).read_bytes()
    (folder / name).write_bytes(b"\x00 nothing of use" + data[: len(data) // 2])
    with pytest.raises(SourceError, match=name):
        read_run(folder)


def test_a_folder_that_is_no_run(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="no run; give a folder"):
        open_run_page(tmp_path)


def test_clouds_come_back_as_they_were(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    points, colours = rng.normal(size=(50, 3)), rng.integers(0, 256, (50, 3)).astype(np.uint8)
    write_ply(tmp_path / "a.ply", points, colours)
    found, rgb = read_ply(tmp_path / "a.ply")
    np.testing.assert_allclose(found, points, rtol=1e-6)
    assert np.array_equal(rgb, colours)


@pytest.fixture
def page(folder: Path) -> Iterator[RunPage]:
    pytest.importorskip("viser")
    opened = open_run_page(folder, 8250)
    yield opened
    opened.stop()


def test_the_rig_goes_where_the_slider_says(page: RunPage) -> None:
    page.show(12)
    np.testing.assert_allclose(page.rig.position, CIRCLE[12][:3, 3], atol=1e-6)
    assert "frame 12 of 40, 6.200 s: **TRACKING**" in page.words.content
    assert "| front | 12 | 21 |" in page.words.content
    page.show(39)
    assert "**LOST**" in page.words.content
    np.testing.assert_allclose(page.rig.position, CIRCLE[12][:3, 3], atol=1e-6)  # it stays


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="no chromium")
def test_a_browser_shows_the_map_and_the_path(page: RunPage, tmp_path: Path) -> None:
    switches = (
        "--headless --no-sandbox --disable-quic --no-first-run --disable-background-networking "
        "--disable-component-update --disable-sync --use-angle=swiftshader --enable-unsafe-swiftshader "
        f"--user-data-dir={tmp_path / 'profile'} --window-size=1300,900 --virtual-time-budget=15000"
    )
    shot = tmp_path / "page.png"
    command = [str(CHROMIUM), *switches.split(), f"--screenshot={shot}", page.address]
    subprocess.run(command, check=True, capture_output=True, timeout=200)
    image = cv2.imread(str(shot))
    assert image is not None
    scene = image[:, :950, ::-1].astype(int)
    assert np.sum(np.abs(scene - RED).max(axis=2) < 40) > 1800  # of 3600 points, a pixel or more each
    red, green, blue = scene[..., 0], scene[..., 1], scene[..., 2]
    assert np.sum((green > red + 40) & (green > blue + 30)) > 300  # the path, in the colour of TRACKING
    assert COLOURS["TRACKING"][1] == max(COLOURS["TRACKING"])
