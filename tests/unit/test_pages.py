"""The files that the how-to pages show are read as they stand."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from facetcam.calibration.board_files import read_boards
from facetcam.design.family import make_rig
from facetcam.design.spec import read_spec
from facetcam.io.odometry import read_odometry
from facetcam.rig import NO_VIEW, Rig

PAGES = Path(__file__).parents[2] / "docs" / "how-to"


def blocks(page: str, language: str) -> list[str]:
    return re.findall(rf"^```{language}\b[^\n]*\n(.*?)^```", (PAGES / page).read_text(), re.S | re.M)


def saved(folder: Path, *texts: str) -> Path:
    path = folder / "shown"
    path.write_text("".join(texts))
    return path


def test_every_view_of_the_rig_shown_has_pixels(tmp_path: Path) -> None:
    rig = Rig.load(saved(tmp_path, blocks("own-rig.md", "yaml")[0]))
    assert rig.view_names == ("front", "wall", "up")
    assert set(np.unique(rig.labels())) == {NO_VIEW, 0, 1, 2}


@pytest.mark.parametrize("more", [0, 1, 2, 3])
def test_the_drawing_shown_can_be_built_with_each_of_its_parts(tmp_path: Path, more: int) -> None:
    parts = blocks("design-a-rig.md", "yaml")
    assert len(parts) == 4
    spec = read_spec(saved(tmp_path, parts[0], parts[more] if more else ""))
    assert make_rig(spec).view_names == ("front", "left", "back", "right")


def test_the_boards_and_the_wheels_shown_are_read(tmp_path: Path) -> None:
    boards = read_boards(saved(tmp_path, blocks("calibrate.md", "yaml")[0])).boards
    assert [board.name for board in boards] == ["north", "south"]
    assert len(read_odometry(saved(tmp_path, blocks("odometry.md", "text")[0])).times) == 2
