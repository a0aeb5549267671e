"""What the page of a design says of a rig, in the words of a workshop."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from facetcam.design.analysis import analyse
from facetcam.design.spec import Body, Optics, read_spec
from facetcam.rig import Camera, Glass, Rig, presets
from facetcam.viz.design_words import azimuths, direction, facts, mirror_words


@pytest.mark.parametrize(
    ("ends", "words"),
    [
        ((-205, -155), "155° to -155°"),
        ((155, 205), "155° to -155°"),
        ((-25, 25), "-25° to 25°"),
        ((-180, -166), "-180° to -166°"),
        ((-180, 180), "all round"),
    ],
)
def test_azimuths_stay_within_half_a_turn(ends: tuple[float, float], words: str) -> None:
    assert azimuths((math.radians(ends[0]), math.radians(ends[1]))) == words


@pytest.mark.parametrize(
    ("axis", "words"),
    [
        ((0, 0, -1), "straight down"),
        ((0, 1, 0), "level, to azimuth 0°"),
        ((1, 0, 0), "level, to azimuth 90°"),
        ((0, -1, 1), "45° up, to azimuth 180°"),
    ],
)
def test_directions_are_told_from_the_front(axis: tuple[float, float, float], words: str) -> None:
    assert direction(np.array(axis, dtype=float)) == words


def test_the_drawing_of_a_rig_file_lists_its_mirrors() -> None:
    rig = presets.table()
    found = facts(rig, read_spec("preset:table"))
    assert found["lens at x, y, z"] == "0, -1000, 1000 mm"
    assert found["mirror left"] == "sides 500, 400, 500, 400 mm"
    behind = mirror_words(replace(rig.mirrors["left"], glass=Glass(0.004, 1.52)))
    assert behind == "sides 500, 400, 500, 400 mm, behind 4.0 mm of glass"


def test_a_camera_that_looks_down_sees_all_round() -> None:
    T = np.diag([1.0, -1.0, -1.0, 1.0])
    rig = Rig(Camera("brown-conrady", 200, 100, 100.0, 100.0, 99.5, 49.5, (0.0,) * 5), T)
    view = analyse(rig, Body(), Optics()).views["front"]
    assert azimuths(view.azimuth) == "all round"
    assert view.elevation[0] == pytest.approx(-math.pi / 2)
    assert view.elevation[1] == pytest.approx(math.atan(math.hypot(1.0, 0.5)) - math.pi / 2, abs=1e-6)
