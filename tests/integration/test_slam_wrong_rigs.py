"""The loop of the house with a lens that is wrong by some per cent: the metre is off by more than that."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import pytest

from facetcam.pipelines.slam import run_slam
from facetcam.rig import Rig
from facetcam.slam import SlamConfig


@pytest.mark.slow
@pytest.mark.parametrize(("per_cent", "wheels"), [(-1.0, False), (-1.0, True), (0.0, False), (3.0, False)])
def test_a_wrong_lens_is_not_metric(shared_data: Path, tmp_path: Path, per_cent: float, wheels: bool) -> None:
    """Neither the run nor any of its states."""
    house, factor = shared_data / "house", 1.0 + per_cent / 100.0
    rig = Rig.load(house / "rig_true.yaml")
    lens = replace(rig.camera, fx=factor * rig.camera.fx, fy=factor * rig.camera.fy)
    replace(rig, camera=lens).save(tmp_path / "rig.yaml")
    files = {"odometry": house / "loop_odometry.csv" if wheels else None, "truth": house / "loop.tum"}
    summary = run_slam(house / "loop.mp4", tmp_path / "rig.yaml", tmp_path / "run", **files)
    with (tmp_path / "run" / "states.csv").open() as file:
        rows = list(csv.DictReader(file))
    metric = [row["metric"] == "1" for row in rows]
    sure = [float(row["scale_sigma"] or "inf") < SlamConfig().metric_sigma for row in rows]
    assert metric == sure
    assert summary.errors is not None
    assert any(metric) == summary.metric == (per_cent == 0.0) == (summary.scale_sigma is not None)
    if summary.metric:
        assert summary.scale_sigma is not None and summary.drawn_scale_sigma is not None
        assert abs(summary.errors.scale_error) < 3.0 * summary.scale_sigma < summary.drawn_scale_sigma
