"""The films of a rendered house: with a wrong rig, wrong wheels, and a rig that is carried about."""

from __future__ import annotations

import json
from itertools import islice
from pathlib import Path

import cv2
import numpy as np
import pytest
from command import Facetcam, only_line

from facetcam.evaluation.trajectory import align
from facetcam.io.sources import open_source
from facetcam.io.trajectories import read_tum
from facetcam.rig import Rig
from facetcam.slam import Slam, Status

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


def test_a_rig_that_is_carried_elsewhere_is_found_again_within_a_second(shared_data: Path) -> None:
    """Picked up in full light, put down where it was before: the next frame may be lost, but never wrong."""
    house = shared_data / "house"
    slam, (_, true) = Slam(Rig.load(house / "rig_true.yaml")), read_tum(house / "loop.tum")
    with open_source(house / "loop.mp4") as source:
        images = [cv2.cvtColor(f.image, cv2.COLOR_BGR2GRAY) for f in islice(source, 150)]
    way = [*range(150), *range(60, 80), *range(20, 40)]
    states = [slam.track(images[k], i / 10.0) for i, k in enumerate(way)]
    found = [i for i, s in enumerate(states) if s.status is Status.TRACKING]
    poses = np.array([states[i].T_world_rig for i in found])[:, :3, 3]
    there = true[[way[i] for i in found], :3, 3]
    before = np.array(found) < 150
    off = align(poses[before], there[before], with_scale=False).apply(poses) - there
    assert np.linalg.norm(off[~before], axis=1).max() < 0.1
    for put_down in (150, 170):
        assert min(i for i in found if i >= put_down) - put_down < 10
    assert len(found) >= len(way) - 15  # of these ten at the start
