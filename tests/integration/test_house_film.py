"""The films of a rendered house: what the rig's file does to them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from command import Facetcam, only_line

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(("film", "seconds"), [("loop", 5), ("lights", 7)])
def test_the_rig_as_drawn_does_not_fit_the_film(
    facetcam: Facetcam, shared_data: Path, tmp_path: Path, film: str, seconds: int
) -> None:
    """A map starts all the same, but its scale is off by a fifth."""
    house, out = shared_data / "house", tmp_path / "run"
    done = facetcam("slam", house / f"{film}.mp4", "--rig", house / "rig_nominal.yaml", "--out", out)
    assert "does not fit this film" in only_line(done)
    assert len((out / "states.csv").read_text().splitlines()) <= 1 + 10 * seconds
    summary = json.loads((out / "summary.json").read_text())
    assert "does not fit this film" in str(summary)
    assert not summary["metric"]


@pytest.mark.parametrize(
    ("factors", "complaint"),
    [((3.28, 3.28, 1.0), "x and y are in metres"), ((1.0, -1.0, -1.0), "the other way")],
    ids=["feet", "mirrored"],
)
def test_odometry_that_tells_nonsense_is_not_used(
    facetcam: Facetcam, shared_data: Path, tmp_path: Path, factors: tuple[float, ...], complaint: str
) -> None:
    house, out, wheels = shared_data / "house", tmp_path / "run", tmp_path / "wheels.csv"
    rows = np.loadtxt(house / "loop_odometry.csv", delimiter=",", skiprows=1) * [1.0, *factors]
    np.savetxt(wheels, rows, "%.6f", ",", header="timestamp,x,y,yaw", comments="")
    rig, truth = house / "rig_true.yaml", house / "loop.tum"
    arguments = ["--odometry", wheels, "--truth", truth, "--max-frames", 120, "--out", out]
    assert facetcam("slam", house / "loop.mp4", "--rig", rig, *arguments).exit_code == 0
    summary = json.loads((out / "summary.json").read_text())
    assert any("odometry not used" in text and complaint in text for text in summary["warnings"])
    assert summary["metric"]
    # By sight alone: 0.04 cm, and a scale within 0.4 %, at one standard deviation of 0.4 %.
    assert summary["errors"]["ate_scaled"]["rmse"] < 0.001
    assert abs(summary["errors"]["scale_error"]) < 0.013


@pytest.mark.parametrize("metre", [0.5, 1.3])
def test_wheels_with_a_metre_of_their_own_do_not_stretch_the_map(
    facetcam: Facetcam, shared_data: Path, tmp_path: Path, metre: float
) -> None:
    """All their steps are wrong alike: as so many witnesses they had moved the scale by eight sigmas."""
    house, out, wheels = shared_data / "house", tmp_path / "run", tmp_path / "wheels.csv"
    rows = np.loadtxt(house / "loop_odometry.csv", delimiter=",", skiprows=1) * [1.0, metre, metre, 1.0]
    np.savetxt(wheels, rows, "%.6f", ",", header="timestamp,x,y,yaw", comments="")
    rig, truth = house / "rig_true.yaml", house / "loop.tum"
    arguments = ["--odometry", wheels, "--truth", truth, "--max-frames", 150, "--out", out]
    assert facetcam("slam", house / "loop.mp4", "--rig", rig, *arguments).exit_code == 0
    summary = json.loads((out / "summary.json").read_text())
    assert summary["metric"]
    assert abs(summary["errors"]["scale_error"]) < 3.0 * summary["scale_sigma"]
