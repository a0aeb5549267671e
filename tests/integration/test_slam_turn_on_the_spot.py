"""A robot that turns once on the spot, and then drives off, in a simulated film of a house."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from simulated_rooms import resized

from facetcam.evaluation.trajectory import evaluate
from facetcam.geometry import se3
from facetcam.io.trajectories import read_tum, write_tum
from facetcam.pipelines.inputs import read_slam_inputs
from facetcam.pipelines.simulate import run_simulate
from facetcam.pipelines.simulate_inputs import Options
from facetcam.rig import Rig
from facetcam.slam import Slam, Status

pytestmark = pytest.mark.slow

Array = NDArray[np.float64]

STILL, SPIN, DRIVE = 3, 60, 25  # frames
FPS = 10.0


def turning(house: Path) -> tuple[Array, Array]:
    """Times and poses: a stand, a whole turn to the left, and the loop of the house from its start."""
    _, loop = read_tum(house / "loop.tum")
    turns = [loop[0] @ se3.exp([0.0, 0.0, 2.0 * np.pi * k / SPIN, 0.0, 0.0, 0.0]) for k in range(SPIN)]
    poses = np.array([*(STILL * [loop[0]]), *turns, *loop[:DRIVE]])
    return np.arange(len(poses)) / FPS, poses


def test_wheels_that_turn_on_the_spot_start_a_map(shared_data: Path, tmp_path: Path) -> None:
    """By the parallax of mirrors that stand beside the axis; a rig had waited until it drove."""
    pytest.importorskip("trimesh", reason="pip install facetcam[sim]")
    house = shared_data / "house"
    resized(Rig.load("preset:ryu"), 0.6).save(tmp_path / "rig.yaml")
    write_tum(tmp_path / "path.tum", *turning(house))
    options = Options(house / "small_house.glb", tmp_path / "rig.yaml", tmp_path / "path.tum", seed=5)
    out = tmp_path / "film"
    run_simulate(options, out)
    files = (out / "film.mp4", out / "rig_true.yaml", out / "odometry.csv", out / "truth.tum")
    inputs = read_slam_inputs(*files, None, None, None)
    slam = Slam(inputs.rig)
    with inputs.source as film:
        states = [slam.track(f.image, f.timestamp, inputs.odometry_at(f.timestamp)) for f in film]
    slam.finish()
    tracked = [state.status is Status.TRACKING for state in states]
    assert tracked.index(True) < STILL + SPIN // 3
    assert np.mean(tracked) > 0.8
    assert inputs.truth is not None
    errors = evaluate(slam.trajectory(), inputs.truth, 0.02)
    assert errors.ate_scaled.rmse < 0.02
    assert not slam.metric or abs(errors.scale_error) < 3.0 * slam.scale_sigma
