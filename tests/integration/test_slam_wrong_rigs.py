"""The loop of the house with a lens that is wrong by some per cent: the metre is off by more than that."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from facetcam.pipelines.slam import run_slam
from facetcam.rig import Rig


@pytest.mark.slow
@pytest.mark.parametrize("per_cent", [-1.0, 0.0, 3.0])
def test_a_wrong_lens_is_not_metric(shared_data: Path, tmp_path: Path, per_cent: float) -> None:
    house, factor = shared_data / "house", 1.0 + per_cent / 100.0
    rig = Rig.load(house / "rig_true.yaml")
    lens = replace(rig.camera, fx=factor * rig.camera.fx, fy=factor * rig.camera.fy)
    replace(rig, camera=lens).save(tmp_path / "rig.yaml")
    summary = run_slam(house / "loop.mp4", tmp_path / "rig.yaml", tmp_path / "run", truth=house / "loop.tum")
    assert summary.errors is not None
    assert summary.metric == (per_cent == 0.0) == (summary.scale_sigma is not None)
    if summary.metric:
        assert summary.scale_sigma is not None and summary.drawn_scale_sigma is not None
        assert abs(summary.errors.scale_error) < 3.0 * summary.scale_sigma < summary.drawn_scale_sigma
