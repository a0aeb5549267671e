"""The demo's short drive: every quantity against the truth, and files that other commands read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from facetcam.errors import OutputError
from facetcam.io.odometry import read_odometry
from facetcam.io.sources import open_source
from facetcam.io.trajectories import read_tum
from facetcam.pipelines.demo import QUICK_FRAMES, run_demo
from facetcam.rig import Rig


def test_the_short_drive(tmp_path: Path) -> None:  # one test, so that it is driven once
    demo = run_demo(tmp_path / "run", quick=True)
    assert [check for check in demo.checks if not check.passed] == []
    assert len(demo.checks) >= 8
    page = demo.report.read_text(encoding="utf-8")
    assert all(check.quantity in page for check in demo.checks)
    assert_files_of_the_slam_command(tmp_path / "run")


def assert_files_of_the_slam_command(folder: Path) -> None:
    """Film, rig, odometry and truth belong together."""
    times, poses = read_tum(folder / "truth.tum")
    with open_source(folder / "film.mp4") as film:
        assert film.size == Rig.load(folder / "rig.yaml").size
        assert np.allclose([frame.timestamp for frame in film], times)
    assert len(poses) == QUICK_FRAMES
    assert np.allclose(read_odometry(folder / "odometry.csv").times, times)


def test_a_folder_that_exists_is_refused_before_anything_is_rendered(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="exists already"):
        run_demo(tmp_path)
