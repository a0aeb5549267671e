"""`facetcam slam`: what it writes and says."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from command import Facetcam, only_line
from fake_slam import FakeSlam
from films import moving, write_film, write_folder
from numpy.typing import NDArray

import facetcam.pipelines.slam
from facetcam.errors import OutputError
from facetcam.io.trajectories import read_tum, write_tum
from facetcam.pipelines import run_slam, slam_results
from facetcam.rig import Rig

FILES = ["colmap", "map.ply", "report.html", "states.csv", "summary.json", "trajectory.tum"]


@pytest.fixture(autouse=True)
def fake(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(facetcam.pipelines.slam, "Slam", FakeSlam)


def true_path(path: Path, shift: float = 0.0) -> Path:
    """A rig that moves at 2 m/s, twice as fast as the stand-in says."""
    times = np.arange(20) / 10.0 + shift
    poses = np.tile(np.eye(4), (20, 1, 1))
    poses[:, 0, 3] = 2.0 * times
    write_tum(path, times, poses)
    return path


def test_files_and_numbers(facetcam: Facetcam, film: Path, rig: Path, tmp_path: Path) -> None:
    out, truth = tmp_path / "out", true_path(tmp_path / "truth.tum")
    result = facetcam("slam", film, "--rig", rig, "--out", out, "--truth", truth)
    assert result.exit_code == 0, result.output
    assert sorted(path.name for path in out.iterdir()) == FILES
    summary = json.loads((out / "summary.json").read_text())
    assert (summary["frames"], summary["tracked"], summary["interrupted"]) == (20, 20, "")
    assert summary["statuses"] == {"STARTING": 2, "TRACKING": 18}
    assert (summary["metric"], summary["scale_sigma"]) == (False, None)
    assert summary["errors"]["scale_error"] == pytest.approx(-0.5)
    for told in ("20 (100 %)", "NOT METRIC (unknown)", "-50.00 %", str(out / "report.html")):
        assert told in result.stdout


@pytest.mark.parametrize(("creep", "warned"), [(0.02, False), (0.25, False), (1.4, True)])
def test_what_was_found_of_shutter_and_camera_is_said(
    facetcam: Facetcam,
    film: Path,
    rig: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    creep: float,
    warned: bool,
) -> None:
    monkeypatch.setattr(FakeSlam, "nuisances", np.array([0.0174, -0.02, creep]))
    result = facetcam("slam", film, "--rig", rig, "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert "17.4 ms from the first row to the last" in result.stdout
    told = f"-0.02, {creep:+.2f} px against its mirrors; corrected" in result.stdout
    assert told == (creep > 0.1)
    assert ("crept by 1.4 px" in result.stderr and "calibrate the rig again" in result.stderr) == warned
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert (summary["readout_s"], summary["creep_px"]) == (0.0174, [-0.02, creep])


def two_maps(monkeypatch: pytest.MonkeyPatch) -> None:
    """The rig was lost for good after a second, and the second map counts."""
    monkeypatch.setattr(FakeSlam, "next_map_from", 10)
    monkeypatch.setattr(FakeSlam, "map_number", 1)
    times = np.arange(10) / 10
    poses = np.tile(np.eye(4), (10, 1, 1))
    poses[:, 1, 3] = times
    monkeypatch.setattr(FakeSlam, "apart", {0: (times, poses)})


def test_maps_that_never_met_are_told_apart(
    facetcam: Facetcam, film: Path, rig: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    two_maps(monkeypatch)
    out = tmp_path / "out"
    result = facetcam("slam", film, "--rig", rig, "--out", out)
    assert result.exit_code == 0, result.output
    assert "another map that never met that of the path: trajectory_map0.tum (10 poses)" in result.stderr
    times, poses = read_tum(out / "trajectory_map0.tum")
    np.testing.assert_allclose(poses[:, 1, 3], times)
    assert not (out / "trajectory_map1.tum").exists()  # it is the path
    summary = json.loads((out / "summary.json").read_text())
    assert (summary["map"], summary["maps_apart"]) == (1, {"0": 10})
    assert (out / "map0.facetmap").read_text() == "0"
    assert summary["tracked"] == 20
    with (out / "states.csv").open() as file:
        assert [row["map"] for row in csv.DictReader(file)] == 10 * ["0"] + 10 * ["1"]


def test_live_poses_stay_where_final_ones_cannot_be_written(
    facetcam: Facetcam, film: Path, rig: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(path: Path, times: NDArray, poses: NDArray) -> None:
        if path.name == "trajectory.tum":
            raise OutputError(f"{path}: cannot be written (No space left on device)")
        write_tum(path, times, poses)

    two_maps(monkeypatch)
    monkeypatch.setattr(slam_results, "write_tum", full)
    result = facetcam("slam", film, "--rig", rig, "--out", tmp_path / "out")
    assert result.exit_code == 1
    times = [read_tum(tmp_path / "out" / name)[0] for name in ("trajectory.tum", "trajectory_map1.tum")]
    np.testing.assert_allclose(np.concatenate(times), np.arange(2, 20) / 10)


def test_live_poses_of_each_map_have_a_file_of_their_own(
    film: Path, rig: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    two_maps(monkeypatch)
    monkeypatch.setattr(facetcam.pipelines.slam, "write_results", lambda *rest: SimpleNamespace(summary=None))
    run_slam(film, rig, tmp_path / "out")
    files = [tmp_path / "out" / name for name in ("trajectory.tum", "trajectory_map1.tum")]
    first, second = (read_tum(file)[0] for file in files)
    np.testing.assert_allclose(first, np.arange(2, 10) / 10)
    np.testing.assert_allclose(second, np.arange(10, 20) / 10)


def test_live_poses_stay_beside_the_final_ones(film: Path, rig: Path, tmp_path: Path) -> None:
    run_slam(film, rig, tmp_path / "out")
    times, poses = read_tum(tmp_path / "out" / "trajectory.tum")
    np.testing.assert_allclose(times, np.arange(20) / 10)
    np.testing.assert_allclose(poses[:, 0, 3], times)
    with (tmp_path / "out" / "states.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["status"] for row in rows] == ["STARTING"] * 2 + ["TRACKING"] * 18
    assert rows[0]["tx"] == ""
    assert float(rows[9]["tx"]) == pytest.approx(0.9)
    assert float(rows[9]["cov_tz_tz"]) == pytest.approx(1e-4)
    assert (rows[9]["front_predicted"], rows[9]["front_inliers"]) == ("5", "1")


def test_odometry_is_interpolated_to_the_frames(
    film: Path, rig: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    slam = FakeSlam(Rig.load(rig), None)
    monkeypatch.setattr(facetcam.pipelines.slam, "Slam", lambda rig, config: slam)
    (tmp_path / "odometry.csv").write_text("timestamp,x,y,yaw\n0,0,0,0\n0.4,4,0,0\n0.8,8,0,1\n1.2,8,0,1\n")
    run_slam(film, rig, tmp_path / "out", odometry=tmp_path / "odometry.csv", max_frames=13)
    assert slam.odometry[1] == pytest.approx((1, 0, 0))
    assert slam.odometry[6] == pytest.approx((6, 0, 0.5))


def test_frames_and_rate_can_be_set(facetcam: Facetcam, rig: Path, tmp_path: Path) -> None:
    folder, out = write_folder(tmp_path / "in", moving(8)), tmp_path / "out"
    result = facetcam("slam", folder, "--rig", rig, "--out", out, "--fps", 4, "--max-frames", 5)
    assert result.exit_code == 0, result.output
    np.testing.assert_allclose(read_tum(out / "trajectory.tum")[0], np.arange(5) / 4)


def test_unreadable_images_are_counted_and_said(facetcam: Facetcam, rig: Path, tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "in", moving(6))
    (folder / "3.png").write_bytes(b"broken")
    result = facetcam("slam", folder, "--rig", rig, "--fps", 10, "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert result.stderr == "facetcam: warning: 3.png skipped: damaged or not an image\n"
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["frames"] == 5
    assert summary["warnings"] == ["3.png skipped: damaged or not an image"]


def test_a_cut_off_film_is_said(facetcam: Facetcam, rig: Path, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    noise = [rng.integers(0, 256, (48, 64, 3), dtype=np.uint8) for _ in range(30)]
    film = write_film(tmp_path / "film.mp4", noise, options={"movflags": "faststart"})
    film.write_bytes(film.read_bytes()[: film.stat().st_size // 2])
    result = facetcam("slam", film, "--rig", rig, "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert "cut off or damaged" in result.stderr


def test_a_truth_on_another_clock_is_said_and_costs_nothing(
    facetcam: Facetcam, film: Path, rig: Path, tmp_path: Path
) -> None:
    truth = true_path(tmp_path / "truth.tum", shift=100.0)
    result = facetcam("slam", film, "--rig", rig, "--out", tmp_path / "out", "--truth", truth)
    assert result.exit_code == 0, result.output
    assert "no comparison with the truth: only 0 of 20" in result.stderr


@pytest.mark.parametrize(
    ("count", "cause"), [(1, "a single frame shows no motion"), (3, "is it dark or blank")]
)
def test_a_film_in_which_nothing_can_be_tracked(
    facetcam: Facetcam, rig: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, count: int, cause: str
) -> None:
    monkeypatch.setattr(FakeSlam, "trajectory", lambda self: (np.empty(0), np.empty((0, 4, 4))))
    black = write_film(tmp_path / "black.mp4", [np.zeros((48, 64, 3), np.uint8)] * count)
    result = facetcam("slam", black, "--rig", rig, "--out", tmp_path / "out")
    assert f"no frame could be tracked; {cause}" in only_line(result)
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == FILES
