"""A small film, its rig, and the command line to use them with."""

from __future__ import annotations

from pathlib import Path

import pytest
from films import moving, write_film

RIG = """\
camera: {model: brown-conrady, width: 64, height: 48, fx: 60, fy: 60, cx: 31.5, cy: 23.5,
         distortion: [0, 0, 0, 0, 0], T_rig_cam: [[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]]}
views: {front: {mirrors: []}}
"""


@pytest.fixture
def film(tmp_path: Path) -> Path:
    """20 frames of 64x48, 10 a second."""
    return write_film(tmp_path / "film.mp4", moving(20))


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    """An ordinary camera of 64x48 without mirrors."""
    (tmp_path / "rig.yaml").write_text(RIG)
    return tmp_path / "rig.yaml"
