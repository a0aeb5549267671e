"""Squares of a wrong size are told from a rig that is not built as drawn."""

from __future__ import annotations

from dataclasses import replace

import pytest
from calibration_worlds import boards, disturbed, sightings_of

from facetcam.calibration import BoardSet
from facetcam.calibration.result import Calibration, Finding
from facetcam.calibration.scale import refuse_far_scale, wrong_scale
from facetcam.calibration.solve import solve
from facetcam.errors import FacetcamError
from facetcam.rig import presets

RIG, SET = presets.ryu(), boards(8, True)


def solved(factor: float, tilt_deg: float, shift: float) -> tuple[Calibration, BoardSet]:
    """The rig if the squares are said to be `factor` times as large as they are."""
    told = BoardSet(
        tuple(replace(b, square=factor * b.square, marker=factor * b.marker) for b in SET.boards), SET.fixed
    )
    drawing = disturbed(RIG, tilt_deg, shift, 0.01, 3)
    return solve(drawing, told, sightings_of(RIG, SET, 12, 0.1)), told


def found(factor: float, tilt_deg: float, shift: float) -> list[Finding]:
    """What is said of it."""
    calibration, told = solved(factor, tilt_deg, shift)
    return [*calibration.findings, *wrong_scale(calibration.fit, told)]


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


@pytest.mark.parametrize("factor", [10.0, 0.1])
def test_a_rig_far_off_its_size_is_refused(factor: float) -> None:
    calibration, told = solved(factor, 0.1, 0.0002)
    with pytest.raises(FacetcamError, match=r"no rig is written.* mm would fit .*boards\.yaml"):
        refuse_far_scale(calibration.fit, told)


@pytest.mark.parametrize(("factor", "tilt_deg", "shift"), [(1.06, 0.1, 0.0002), (1.0, 1.0, 0.002)])
def test_a_rig_near_its_size_is_not_refused(factor: float, tilt_deg: float, shift: float) -> None:
    calibration, told = solved(factor, tilt_deg, shift)
    refuse_far_scale(calibration.fit, told)
