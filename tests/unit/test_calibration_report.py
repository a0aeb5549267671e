"""The page of a calibration: it says what is known and what is not, and survives what is missing."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from facetcam.calibration import Board, BoardSet, Sighting
from facetcam.calibration.quality import Flatness, MirrorDeviation, UncertaintyMap, Validation
from facetcam.calibration.result import Calibration, Finding, FittedSighting, Parameters, Unknown
from facetcam.rig import Rig
from facetcam.viz.calibration_page import CalibrationReport, PhotoRow, crop_of, write_calibration_report
from facetcam.viz.calibration_words import deviation_row, digits_of, tiles, verdict

NOISE = 0.05


def calibration(noise: float = NOISE) -> Calibration:
    """Two photos in which every view of the pyramid sees a board; one corner a sighting is 9 px off."""
    rig = Rig.load("preset:pyramid")
    rng = np.random.default_rng(0)
    fitted = []
    for photo in range(2):
        for index, view in enumerate(rig.view_names):
            inside = np.argwhere(rig.labels() == index)[:, ::-1].astype(float)
            predicted = inside[rng.choice(len(inside), 40, replace=False)]
            pixels = predicted + rng.normal(0, noise, predicted.shape)
            pixels[0] += 9.0
            kept = np.arange(40) > 0
            fitted.append(
                FittedSighting(Sighting(photo, 0, np.arange(40), pixels, True, view), predicted, kept)
            )
    camera = Parameters(("fx", "k3"), ("px", ""), np.array([1200.0, 0.1]), np.array([0.5, np.nan]), np.eye(2))
    boards = BoardSet((Board("<b>wall</b>", "charuco", (6, 9), 0.03, 0.02, "DICT_4X4_50"),))
    return Calibration(rig, rig, boards, {}, {}, {}, tuple(fitted), camera, noise)


def validation(held_out: float) -> Validation:
    u, v = np.meshgrid(np.arange(0.0, 640, 20), np.arange(0.0, 480, 20))
    sigma = np.where(u < 300, 0.02, np.nan)
    blank = np.full_like(u, np.nan)
    names = Rig.load("preset:pyramid").view_names
    maps = [
        UncertaintyMap(names[0], u, v, sigma, sigma, 2.0),
        UncertaintyMap(names[1], u, v, blank, blank, 2.0),
    ]
    return Validation(
        held_out,
        {0: held_out},
        1.25,
        1.17,
        {0: 1.25},
        0.03,
        {names[0]: 0.03},
        Flatness(0.05, 0.05, 1.1, True, names[0]),
        (MirrorDeviation("m", 0.5, 1.0, 0.01, 0.02), MirrorDeviation("n", 0.0, 0.0, math.nan, math.nan)),
        tuple(maps),
    )


def test_the_page_shows_everything(tmp_path: Path) -> None:
    solved = replace(
        calibration(),
        unobservable=(Unknown("mirror 'm' is seen only alone", "show two boards at once", ("m",)),),
        findings=(Finding("moved board", "board 'wall' moved before photo 1", (1,)),),
    )
    crop = crop_of(np.zeros((480, 640), np.uint8), np.array([1.0, 478.0]), np.array([5.0, 470.0]), "a.jpg")
    report = CalibrationReport(
        "Rig",
        solved,
        validation(0.07),
        [PhotoRow("a.jpg", 1.2), PhotoRow("b.jpg", math.nan)],
        ["w"],
        (),
        [crop],
    )
    write_calibration_report(report, tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text()
    for words in (
        "seen only alone",
        "Show two boards at once",
        "moved before photo 1",
        "a.jpg",
        "not determined",
        "W.",
    ):
        assert words in page, words
    assert page.count("<svg") == 4
    assert "<b>wall" not in page
    assert not re.search(r"\bnan\b", page)
    assert "http" not in page.replace("http://www.w3.org", "").replace("http://purl.org", "").replace(
        "https://matplotlib.org", ""
    ).replace("http://creativecommons.org", "")


def test_a_page_without_validation(tmp_path: Path) -> None:
    write_calibration_report(
        CalibrationReport("Rig", calibration(), None, [PhotoRow("a.jpg", 1.0)]), tmp_path / "report.html"
    )
    page = (tmp_path / "report.html").read_text()
    assert "was not tried" in page
    assert "As built against as drawn" not in page


def test_the_verdict_is_good_only_when_nothing_speaks_against_it() -> None:
    good = calibration()
    assert verdict(good, validation(0.075)).startswith("Good to use")
    assert "worse than noise explains" in verdict(good, validation(0.2))
    lost = replace(good, unobservable=(Unknown("x"),))
    assert "one thing that matters could not be determined" in verdict(lost, validation(0.075))
    assert verdict(replace(good, unobservable=(Unknown("x", harmless=True),)), validation(0.075)).startswith(
        "Good"
    )
    moved = replace(good, findings=(Finding("moved board", "m"),))
    assert "a board moved" in verdict(moved, validation(0.075))
    breathing = replace(good, findings=(Finding("focus", "f"),))
    assert "the lens was not the same in all photos" in verdict(breathing, validation(0.075))
    unplaced = replace(validation(0.075), flatness=Flatness(0.1, 0.05, 9.0, False, ""))
    assert verdict(good, unplaced).endswith("but the mirrors do not look flat.")
    bent = replace(validation(0.075), flatness=Flatness(0.1, 0.05, 9.0, False, "front"))
    assert "do not look flat in 'front'" in verdict(good, bent)
    assert "differ by 191\u00a0px" in verdict(good, replace(validation(0.075), split_half_rms=191.0))


@pytest.mark.parametrize(
    ("unknown", "shown"),
    [((), "0"), ((True,), "1, harmless"), ((False, True), "1"), ((True, True), "2, harmless")],
)
def test_directions_that_do_no_harm_are_counted_as_such(unknown: tuple[bool, ...], shown: str) -> None:
    opened = tuple(Unknown("x", harmless=harmless) for harmless in unknown)
    told = {label: value for label, value, _ in tiles(replace(calibration(), unobservable=opened), None)}
    assert told["not determined"] == shown


@pytest.mark.parametrize("noise", [0.05, 0.5])
def test_the_rms_is_that_of_the_corners_kept(noise: float) -> None:
    assert abs(calibration(noise).rms() - noise * math.sqrt(2)) < 0.1 * noise


@pytest.mark.parametrize(
    ("sigma", "least", "digits"),
    [(0.0021, 3, 4), (2.1e-6, 5, 7), (0.3, 3, 3), (12.0, 2, 2), (math.nan, 5, 5)],
)
def test_sigmas_of_good_rigs_keep_two_digits_that_count(sigma: float, least: int, digits: int) -> None:
    assert digits_of(sigma, least) == digits


def test_mirrors_are_told_as_finely_as_they_are_known() -> None:
    assert deviation_row(MirrorDeviation("m", 0.51234, 1.0, 0.00042, 0.0031))[1:] == [
        "0.51234° ± 0.00042",
        "+1.0000 mm ± 0.0031",
    ]
