"""Squares of a wrong size are told from a rig that is not built as drawn."""

from __future__ import annotations

from dataclasses import replace

import pytest
from calibration_worlds import boards, disturbed, sightings_of

from facetcam.calibration import BoardSet
from facetcam.calibration.result import Finding
from facetcam.calibration.scale import wrong_scale
from facetcam.calibration.solve import solve
from facetcam.rig import Mirror, presets

RIG, SET = presets.ryu(), boards(8, True)


def found(factor: float, tilt_deg: float, shift: float) -> list[Finding]:
    """What is said of the scale if the squares are said to be `factor` times as large as they are."""
    told = BoardSet(
        tuple(replace(b, square=factor * b.square, marker=factor * b.marker) for b in SET.boards), SET.fixed
    )
    drawing = disturbed(RIG, tilt_deg, shift, 0.01, 3)
    solved = solve(drawing, told, sightings_of(RIG, SET, 12, 0.1))
    return list(wrong_scale(solved.fit, told))


@pytest.mark.parametrize("factor", [1.06, 0.94])
def test_squares_of_a_wrong_size_are_named(factor: float) -> None:
    (finding,) = found(factor, 0.1, 0.0002)
    said = float(finding.words.split("; ")[1].split(" mm")[0])
    assert said == pytest.approx(1e3 * SET.boards[0].square, rel=0.01)
    assert ("farther" in finding.words) == (factor > 1)


@pytest.mark.parametrize(("tilt_deg", "shift"), [(0.1, 0.0002), (1.0, 0.002)])
def test_a_rig_unlike_its_drawing_is_not_blamed_on_squares(tilt_deg: float, shift: float) -> None:
    assert not found(1.0, tilt_deg, shift)


def test_a_drawing_of_another_size_altogether_is_named() -> None:
    solved = solve(RIG, SET, sightings_of(RIG, SET, 12, 0.1)).fit
    mirrors = {name: Mirror.from_polygon(name, 0.4 * RIG.mirrors[name].polygon) for name in RIG.mirrors}
    T_rig_cam = RIG.T_rig_cam.copy()
    T_rig_cam[:3, 3] *= 0.4
    drawn = replace(RIG, mirrors=mirrors, T_rig_cam=T_rig_cam)
    (finding,) = wrong_scale(replace(solved, nominal=drawn), SET)
    assert finding.words.startswith("the views stand nowhere near where they are drawn: measure the boards")
    assert "would fit" not in finding.words
