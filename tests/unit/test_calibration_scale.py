"""Squares of a wrong size are told from a rig that is not built as drawn."""

from __future__ import annotations

from dataclasses import replace

import pytest
from calibration_worlds import boards, disturbed, sightings_of

from facetcam.calibration import BoardSet
from facetcam.calibration.result import Finding
from facetcam.calibration.scale import wrong_scale
from facetcam.calibration.solve import solve
from facetcam.rig import presets

RIG, SET = presets.ryu(), boards(8, True)


def found(factor: float, tilt_deg: float, shift: float) -> list[Finding]:
    """What is said of the scale if the squares are said to be `factor` times as large as they are."""
    told = BoardSet(
        tuple(replace(b, square=factor * b.square, marker=factor * b.marker) for b in SET.boards), SET.fixed
    )
    drawing = disturbed(RIG, tilt_deg, shift, 0.01, 3)
    solved = solve(drawing, told, sightings_of(RIG, SET, 12, 0.1))
    return [*solved.findings, *wrong_scale(solved.fit, told)]


@pytest.mark.parametrize(
    ("factor", "within"), [(1.06, 0.01), (0.94, 0.01), (2.0, 0.1), (10.0, 0.01), (0.1, 0.02)]
)
def test_squares_of_a_wrong_size_are_named(factor: float, within: float) -> None:
    (finding,) = found(factor, 0.1, 0.0002)
    said = float(finding.words.split("; ")[1].split(" mm")[0].removeprefix("about "))
    assert said == pytest.approx(1e3 * SET.boards[0].square, rel=within)
    told = float(finding.words.split("stand ")[1].split(" times")[0])
    assert told == pytest.approx(factor, rel=within)


@pytest.mark.parametrize(("tilt_deg", "shift"), [(0.1, 0.0002), (1.0, 0.002)])
def test_a_rig_unlike_its_drawing_is_not_blamed_on_squares(tilt_deg: float, shift: float) -> None:
    assert not found(1.0, tilt_deg, shift)
