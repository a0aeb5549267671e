"""The films of a rendered house: what the rig's file does to them."""

from __future__ import annotations

from pathlib import Path

import pytest
from command import Facetcam, only_line

pytestmark = pytest.mark.slow


def test_the_rig_as_drawn_does_not_fit_the_film(
    facetcam: Facetcam, shared_data: Path, tmp_path: Path
) -> None:
    house, out = shared_data / "house", tmp_path / "run"
    done = facetcam("slam", house / "loop.mp4", "--rig", house / "rig_nominal.yaml", "--out", out)
    assert "does not fit this film" in only_line(done)
    assert len((out / "states.csv").read_text().splitlines()) <= 51  # a header and the first five seconds
    assert "does not fit this film" in (out / "summary.json").read_text()
