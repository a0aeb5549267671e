"""Photos that crept are named by a test that keeps to its chance of a false alarm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from calibration_worlds import boards, sightings_of

from facetcam.calibration.creep import CHANCE, creeps
from facetcam.calibration.fit import Fit
from facetcam.calibration.solve import solve
from facetcam.rig import presets

RIG, SET, NOISE = presets.table(), boards(1, True), 0.1


@pytest.fixture(scope="module")
def fit() -> Fit:
    solved = solve(RIG, SET, sightings_of(RIG, SET, 20, NOISE)).fit
    assert isinstance(solved, Fit)
    return solved


def drawn(
    fit: Fit, random: np.random.Generator, usual: float, crept: int | None = None, shift: float = 0.0
) -> Fit:
    """The corners anew: noise, a usual shift of every view, and one more of a view of one photo."""
    looks = fit.looks
    sides = np.stack([looks.station, looks.view], axis=1)
    which = np.unique(sides, axis=0, return_inverse=True)[1].ravel()
    aside = usual * random.standard_normal((which.max() + 1, 2))
    if crept is not None:
        station = [photo for photo, _ in fit.stations].index(crept)
        aside[which[np.flatnonzero(looks.station == station)[0]]] += (shift, 0.0)
    pixels = fit.state.predict(looks) + NOISE * random.standard_normal(looks.pixels.shape)
    pixels += aside[which][looks.sighting]
    return replace(fit, looks=replace(looks, pixels=pixels), kept=np.ones(len(pixels), dtype=bool))


@pytest.mark.parametrize("usual", [0.0, 0.2])
def test_a_still_set_is_seldom_accused(fit: Fit, usual: float) -> None:
    random = np.random.default_rng(1)
    alarms = sum(creeps(drawn(fit, random, usual))[0].chance < CHANCE for _ in range(60))
    assert alarms <= 60 * CHANCE + 2 * np.sqrt(60 * CHANCE)


@pytest.mark.parametrize("usual", [0.0, 0.1])
def test_a_photo_that_crept_is_named(fit: Fit, usual: float) -> None:
    random = np.random.default_rng(2)
    views = [{s.view for s in fit.sightings if s.photo == p} for p in fit.photos]
    photo = fit.photos[int(np.argmax([len(v) for v in views]))]  # where the pose cannot take the shift up
    found = [creeps(drawn(fit, random, usual, photo, 2.0))[0] for _ in range(20)]
    assert all(c.photo == photo and c.chance < CHANCE for c in found)
    assert np.mean([c.shift for c in found]) == pytest.approx(2.0, abs=0.4)


def test_two_photos_tell_nothing_of_what_is_usual(fit: Fit) -> None:
    assert creeps(fit.of_photos(fit.photos[:2])) == ()
