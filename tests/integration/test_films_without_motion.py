"""Films from which no motion can be learned: the whole line invents none and says so."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from command import Facetcam, only_line
from films import textured, write_folder
from numpy.typing import NDArray

Images = list[NDArray[np.uint8]]

HEIGHT, WIDTH = 1200, 1600  # of the presets' camera
NOISE = 2.0  # grey values of 255


def black(count: int) -> Images:
    return [np.zeros((HEIGHT, WIDTH, 3), np.uint8)] * count


def standing(count: int) -> Images:
    """The same picture with fresh noise."""
    rng, picture = np.random.default_rng(1), textured(HEIGHT, WIDTH).astype(np.float32)
    noisy = (picture + rng.normal(0, NOISE, picture.shape) for _ in range(count))
    return [np.clip(image, 0, 255).astype(np.uint8) for image in noisy]


@pytest.mark.parametrize("preset", ["ryu", "table"])
@pytest.mark.parametrize(
    ("film", "count", "cause"),
    [
        (black, 5, "is it dark or blank"),
        (standing, 8, "does the camera stand still"),
        (standing, 1, "a single frame shows no motion"),
    ],
)
def test_no_motion_is_invented(
    facetcam: Facetcam, tmp_path: Path, preset: str, film: Callable[[int], Images], count: int, cause: str
) -> None:
    folder, out = write_folder(tmp_path / "in", film(count)), tmp_path / "out"
    line = only_line(facetcam("slam", folder, "--fps", 10, "--rig", f"preset:{preset}", "--out", out))
    assert "no frame could be tracked" in line
    assert cause in line
    summary = json.loads((out / "summary.json").read_text())
    assert (summary["frames"], summary["tracked"], summary["metric"]) == (count, 0, False)
    with (out / "states.csv").open() as file:
        assert {row["status"] for row in csv.DictReader(file)} == {"STARTING"}


def test_a_standing_robot_stays_where_its_wheels_say(facetcam: Facetcam, tmp_path: Path) -> None:
    folder, out = write_folder(tmp_path / "in", standing(8)), tmp_path / "out"
    (tmp_path / "wheels.csv").write_text(
        "timestamp,x,y,yaw\n" + "".join(f"{k / 10},0,0,0\n" for k in range(8))
    )
    result = facetcam(
        "slam", folder, "--fps", 10, "--rig", "preset:ryu", "--out", out,
        "--odometry", tmp_path / "wheels.csv",
    )  # fmt: skip
    summary = json.loads((out / "summary.json").read_text())
    assert summary["path_length"] < 1e-3, result.output
    assert not summary["metric"]
