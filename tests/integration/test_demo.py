"""The demo's short drive: every quantity against the truth, and files that other commands read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from facetcam.errors import OutputError
from facetcam.io.odometry import read_odometry
from facetcam.io.sources import open_source
from facetcam.io.trajectories import read_tum
from facetcam.pipelines.demo import QUICK_FRAMES, Demo, run_demo
from facetcam.rig import Rig


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Demo:
    return run_demo(tmp_path_factory.mktemp("demo") / "run", quick=True)


def test_every_quantity_is_as_expected(demo: Demo) -> None:
    assert [check for check in demo.checks if not check.passed] == []
    assert len(demo.checks) >= 8
    assert demo.passed


def test_the_report_shows_the_table(demo: Demo) -> None:
    page = demo.report.read_text(encoding="utf-8")
    assert all(check.quantity in page for check in demo.checks)


def test_the_files_are_those_of_the_slam_command(demo: Demo) -> None:
    folder = demo.report.parent
    rig = Rig.load(folder / "rig.yaml")
    times, poses = read_tum(folder / "truth.tum")
    wheels = read_odometry(folder / "odometry.csv")
    with open_source(folder / "film.mp4") as film:
        frames = [frame.timestamp for frame in film]
        assert film.size == rig.size
    assert len(frames) == len(poses) == QUICK_FRAMES
    assert np.allclose(frames, times)
    assert np.allclose(wheels.times, times)


def test_a_folder_that_exists_is_refused_before_anything_is_rendered(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="exists already"):
        run_demo(tmp_path)
