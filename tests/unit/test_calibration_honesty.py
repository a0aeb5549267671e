"""Held-out photos, intruders, and what is said before a solve."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from calibration_worlds import boards, disturbed, sightings_of, walk

from facetcam.calibration.across_views import across_views
from facetcam.calibration.covariance import knowledge, shared_covariance
from facetcam.calibration.difference import projection_difference, room_points
from facetcam.calibration.fit import Fit
from facetcam.calibration.preflight import preflight
from facetcam.calibration.quality import Validation
from facetcam.calibration.result import Calibration
from facetcam.calibration.sightings import Sighting
from facetcam.calibration.solve import solve
from facetcam.calibration.synthetic import projected_sightings
from facetcam.calibration.uncertainty import uncertainty_maps
from facetcam.calibration.validation import validate
from facetcam.rig import Rig, View, presets

NOISE = 0.1
RIG, SET = presets.ryu(), boards(8, True)


@pytest.fixture(scope="module")
def calibration() -> Calibration:
    return solve(disturbed(RIG, 1.0, 0.002, 0.03, 0), SET, sightings_of(RIG, SET, 16, NOISE))


@pytest.fixture(scope="module")
def judged(calibration: Calibration) -> Validation:
    return validate(calibration)


def test_held_out_photos_fit_as_well_as_noise_allows(calibration: Calibration, judged: Validation) -> None:
    found = judged
    assert NOISE * np.sqrt(2) * 0.9 < found.held_out_rms < NOISE * np.sqrt(2) * 1.5
    assert set(found.held_out) <= {s.sighting.photo for s in calibration.sightings}
    assert found.split_half_rms < 1.0
    assert found.flatness is not None and found.flatness.flat and 0.2 < found.flatness.ratio < 3.0
    assert np.isnan(found.deviations[0].tilt_sigma_deg)  # the base follows from the drawing


def test_the_error_from_one_view_to_the_others_is_foretold(
    calibration: Calibration, judged: Validation
) -> None:
    fit: Fit = calibration.fit.of_photos(calibration.fit.photos[:6])
    shared = shared_covariance(calibration.fit, NOISE)
    root = np.linalg.svd(shared)
    root = root.U * np.sqrt(root.S)
    random = np.random.default_rng(5)
    exact = fit.state.predict(fit.looks)
    squares, foretold = [], []
    for _ in range(
        12
    ):  # a rig as wrong as it is said to be, and photos with the noise that they are said to have
        wrong = fit.state.moved(root @ random.standard_normal(len(shared)), np.zeros((len(fit.stations), 6)))
        pixels = exact + NOISE * fit.looks.noise[:, None] * random.standard_normal(exact.shape)
        found = across_views(
            replace(fit, state=wrong, looks=replace(fit.looks, pixels=pixels)), shared, NOISE
        )
        squares.append(np.sum(found.residuals**2, axis=1))
        foretold.append(found.variances)
    assert np.sum(squares) / np.sum(foretold) == pytest.approx(1.0, abs=0.25)
    assert np.mean(np.array(squares) / np.array(foretold)) == pytest.approx(1.0, abs=0.25)
    assert np.mean(foretold) > 10 * 2 * NOISE**2  # far more than the noise of a corner
    assert 0.5 < judged.cross_view_rms / judged.cross_view_expected < 2.0


def test_maps_predict_the_error_of_the_views(calibration: Calibration, judged: Validation) -> None:
    points = room_points(RIG, list(RIG.views), 300, span=(1.9, 2.1))
    real = projection_difference(RIG, calibration.rig, points).by_view
    for m in judged.maps:
        assert 0.2 < real[m.view] / np.nanmedian(m.sigma_px) < 3.0
        assert np.nanmedian(m.sigma_mm) == pytest.approx(
            np.nanmedian(m.sigma_px) / 1250 * m.depth * 1e3, rel=0.3
        )


def test_a_mirror_that_is_bent_is_named(calibration: Calibration) -> None:
    bowed = []
    for f in calibration.sightings:
        pixels, middle = f.sighting.pixels, np.array([RIG.camera.cx, RIG.camera.cy])
        if f.sighting.view == "left":  # a bow of 1 mm over 100 mm turns and stretches what it shows
            pixels = middle + 1.002 * (pixels - middle)
        bowed.append(replace(f.sighting, pixels=pixels, view=None))
    found = validate(solve(disturbed(RIG, 1.0, 0.002, 0.03, 0), SET, bowed)).flatness
    assert found is not None and not found.flat
    assert found.worst_view == "left" and found.ratio > 10.0


def test_maps_lie_over_their_views(calibration: Calibration, judged: Validation) -> None:
    labels = calibration.rig.labels()
    for m in judged.maps:
        assert max(m.u.shape) == pytest.approx(40, abs=1)
        step = m.u[0, 1] - m.u[0, 0]
        area = np.count_nonzero(labels == RIG.view_names.index(m.view))
        assert step**2 * np.isfinite(m.sigma_px).sum() == pytest.approx(area, rel=0.05)


def test_what_is_unknown_of_the_lens_far_from_all_boards_spoils_no_map_near_them() -> None:
    set = boards(2, False, 0.02, (9, 7))
    camera = RIG.camera
    rig = Rig(replace(camera, distortion=(-0.1, 0.03, 0.0, 0.0, 0.0)), np.eye(4), {}, {"direct": View(())})
    middle = np.array([[camera.cx, camera.cy]])
    sightings = []
    for s in sightings_of(rig, set, 30, NOISE):
        near = np.linalg.norm(s.pixels - middle, axis=1) < 0.5 * camera.cy
        sightings.append(replace(s, corners=s.corners[near], pixels=s.pixels[near]))
    found = solve(rig, set, sightings)
    (m,) = uncertainty_maps(found.fit, knowledge(found.fit, NOISE), 0.5)
    away = np.hypot(m.u - camera.cx, m.v - camera.cy)
    inner, outer = (
        np.nanmedian(m.sigma_px[part]) for part in (away < 0.4 * camera.cy, away > 1.4 * camera.cy)
    )
    assert inner < NOISE < 20 * inner < outer


def test_the_rig_file_carries_what_is_known(calibration: Calibration, tmp_path: Path) -> None:
    calibration.rig.save(tmp_path / "rig.yaml")
    back = Rig.load(tmp_path / "rig.yaml")
    assert back.covariance is not None and set(back.covariance.axes) == {"front", "back", "left", "right"}
    np.testing.assert_array_equal(back.covariance.matrix, calibration.parameters.covariance)
    assert back.solved_from == calibration.rig.solved_from and calibration.nominal.solved_from is None


def test_sightings_seen_worse_count_less() -> None:
    random = np.random.default_rng(3)
    factor = {b: 6.0 if b in (1, 4, 6) else 1.0 for b in range(8)}
    noisy = [
        replace(s, pixels=s.pixels + 0.03 * factor[s.board] * random.standard_normal(s.pixels.shape))
        for s in sightings_of(RIG, SET, 16, 0.0)
    ]
    found = solve(disturbed(RIG, 1.0, 0.002, 0.03, 0), SET, noisy)
    looks = found.fit.looks
    many = np.bincount(looks.sighting) > 20
    spread = {
        k: looks.spread[many & ((np.array(list(factor.values())) > 1)[looks.board] == k)] for k in (0, 1)
    }
    assert np.median(spread[1]) / np.median(spread[0]) == pytest.approx(6.0, rel=0.35)
    assert found.fit.kept.mean() > 0.99  # what is seen worse is not thrown away
    blind = replace(found.fit, looks=replace(looks, spread=np.ones_like(looks.spread))).solved(None)
    points = room_points(RIG, list(RIG.views), 300)
    weighed, all_alike = (projection_difference(RIG, r, points).rms for r in (found.rig, blind.rig))
    assert weighed < 0.7 * all_alike


def test_names_the_photos_of_another_camera() -> None:
    placed = walk(RIG, SET, 16)
    zoomed = replace(RIG, camera=replace(RIG.camera, fx=1330.0, fy=1330.0))
    sightings = [s for s in projected_sightings(RIG, SET, placed, NOISE) if s.photo not in (2, 15)]
    sightings += [s for s in projected_sightings(zoomed, SET, placed, NOISE) if s.photo in (2, 15)]
    found = [f for f in solve(RIG, SET, sightings).findings if f.kind == "other camera"]
    assert [f.photos for f in found] == [(2, 15)]
    assert "1330" in found[0].text or "1329" in found[0].text or "1331" in found[0].text


def without_left(sightings: list[Sighting]) -> list[Sighting]:
    truth = solve(RIG, SET, sightings)
    view = {(f.sighting.photo, f.sighting.board, len(f.sighting)): f.sighting.view for f in truth.sightings}
    return [s for s in sightings if view.get((s.photo, s.board, len(s))) != "left"]


def test_a_mirror_that_no_photo_shows_stays_as_drawn() -> None:
    drawing = disturbed(RIG, 1.0, 0.002, 0.03, 0)
    found = solve(drawing, SET, without_left(sightings_of(RIG, SET, 16, NOISE)))
    (unknown,) = (u for u in found.unobservable if not u.harmless)
    assert unknown.what == "no photo shows a board in view 'left'; mirror 'left' stays as drawn"
    assert "in view 'left'" in unknown.advice
    assert found.rig.mirrors["left"] == drawing.mirrors["left"]
    assert found.rig.covariance is not None and set(found.rig.covariance.axes) == {"front", "back", "right"}
    assert not any(name.startswith("left") for name in found.parameters.names)


def test_says_before_the_solve_which_view_is_missing() -> None:
    sightings = sightings_of(RIG, SET, 16, NOISE)
    whole = preflight(RIG, SET, sightings)
    assert whole.enough and min(whole.sightings.values()) > 0
    partial = preflight(RIG, SET, without_left(sightings))
    assert not partial.enough
    assert any("'left'" in u.what and "no photo" in u.what for u in partial.unobservable)
    assert any("'left'" in line for line in partial.advice)
