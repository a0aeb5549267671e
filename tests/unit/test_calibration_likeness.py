"""Corners of a photo that err alike: how often the truth lies within what the covariance says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from calibration_worlds import boards, sightings_of
from numpy.typing import NDArray

from facetcam.calibration.boards import BoardSet
from facetcam.calibration.covariance import knowledge
from facetcam.calibration.fit import Fit
from facetcam.calibration.optics import MirrorOptics
from facetcam.calibration.sightings import Sighting
from facetcam.calibration.solve import solve
from facetcam.rig import Rig, presets

Array = NDArray[np.float64]

NOISE = 0.1  # pixels


def bent(fit: Fit, exact: Array, amount: float, random: np.random.Generator) -> Array:
    """Pixels of boards each of which bends anew in every photo, with the noise of the corners."""
    pixels = exact + NOISE * random.standard_normal(exact.shape)
    bends: dict[tuple[int, int], Array] = {}
    for s, (first, last) in zip(fit.sightings, fit.looks.bounds):
        u, v = (fit.looks.points[first:last, :2] / np.ptp(fit.looks.points[:, :2], axis=0) - 0.5).T
        bend = bends.setdefault((s.photo, s.board), amount * random.standard_normal((3, 2)))
        pixels[first:last] += np.column_stack([u * u - 1 / 12, v * v - 1 / 12, u * v]) @ bend
    return np.asarray(pixels)


def _exact(seen: Sighting, clean: list[Sighting]) -> Array:
    """Where the corners of a sighting are: a photo may show them in several views."""
    same = [
        s.pixels
        for s in clean
        if (s.photo, s.board) == (seen.photo, seen.board) and np.array_equal(s.corners, seen.corners)
    ]
    return min(same, key=lambda pixels: float(np.abs(pixels - seen.pixels).max()))


def errors_in_sigmas(rig: Rig, set: BoardSet, photos: int, amount: float, trials: int) -> tuple[Array, Array]:
    """Of all numbers of lens and mirrors, by corners that err independently and by photos."""
    fit = solve(rig, set, sightings_of(rig, set, photos, NOISE, 1)).fit
    optics = fit.state.optics
    assert isinstance(optics, MirrorOptics)
    camera = rig.camera
    truth = np.array(
        [camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion, *np.zeros(optics.count)]
    )
    clean = sightings_of(rig, set, photos, 0.0, 1)
    exact = np.concatenate([_exact(s, clean) for s in fit.sightings])
    random, alone, together = np.random.default_rng(7), [], []
    for _ in range(trials):
        looks = replace(
            fit.looks, pixels=bent(fit, exact, amount, random), spread=np.ones(len(fit.sightings))
        )
        found = replace(fit, looks=looks, kept=np.ones(len(exact), dtype=bool)).solved(None, 15)
        noise = float(np.sqrt(np.mean(found.residuals**2)))
        values = np.concatenate([found.state.intrinsics, found.state.optics.values])  # type: ignore[attr-defined]
        for settled, errors in ((False, alone), (True, together)):
            known = knowledge(found, noise, settled)
            errors.append((values - truth)[known.free] / known.sigma)
    return tuple(np.abs(z[np.isfinite(z)]) for z in map(np.concatenate, (alone, together)))  # type: ignore[return-value]


@pytest.mark.parametrize("amount", [0.0, 2.0])
def test_sigmas_hold_whether_boards_bend_or_not(amount: float) -> None:
    rig = presets.table()
    alone, together = errors_in_sigmas(rig, boards(1, False, 0.025, (8, 6)), 14, amount, 10)
    assert 0.58 < np.mean(together < 1) < 0.80
    assert np.mean(together < 3) > 0.97
    if amount:
        assert np.mean(alone < 1) < 0.5, "corners of a bent board are no independent witnesses"


def test_a_few_photos_that_agree_change_nothing() -> None:
    rig, set = presets.table(), boards(1, False, 0.025, (8, 6))
    fit = solve(rig, set, sightings_of(rig, set, 4, NOISE, 1)).fit
    alone, together = (knowledge(fit, NOISE, settled) for settled in (False, True))
    ratio = np.sqrt(np.diag(together.covariance) / np.diag(alone.covariance))
    assert 0.7 < together.factor < 1.5
    assert np.all((ratio >= 0.999) & (ratio < 1.6))
    np.testing.assert_array_equal(together.open_directions, alone.open_directions)
