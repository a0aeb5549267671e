"""A simulated film of a house through a pyramid of mirrors, tracked against its truth."""

from __future__ import annotations

from pathlib import Path

import pytest
from simulated_rooms import resized

from facetcam.pipelines.inputs import read_slam_inputs
from facetcam.pipelines.simulate import run_simulate
from facetcam.pipelines.simulate_inputs import Options
from facetcam.pipelines.slam import track_film
from facetcam.rig import Rig

pytestmark = pytest.mark.slow

LIGHT = """
camera: {samples: 2, exposure_time: 0.004, readout: 0.01, vignetting: 0.3}
light:
  lamps:
  - {position: [-6, 1, 2.2]}
  - {position: [-1, 1, 2.2]}
  - {position: [3, 1, 2.2]}
  - {position: [6, -3, 2.2]}
"""


def test_the_film_of_a_pyramid_is_tracked(shared_data: Path, tmp_path: Path) -> None:
    pytest.importorskip("trimesh", reason="pip install facetcam[sim]")
    house = shared_data / "house"
    resized(Rig.load("preset:pyramid"), 0.5).save(tmp_path / "rig.yaml")
    (tmp_path / "settings.yaml").write_text(LIGHT)
    options = Options(
        house / "small_house.glb",
        tmp_path / "rig.yaml",
        house / "loop.tum",
        settings=tmp_path / "settings.yaml",
        seed=3,
        max_frames=61,
    )
    out = tmp_path / "film"
    assert run_simulate(options, out).frames == 61
    files = (out / "film.mp4", out / "rig_true.yaml", out / "odometry.csv", out / "truth.tum")
    summary = track_film(read_slam_inputs(*files, None, None, None), tmp_path / "slam").summary
    assert summary.tracked >= 55
    assert summary.errors is not None
    assert summary.errors.ate_scaled.rmse < 0.01 * summary.errors.true_length
