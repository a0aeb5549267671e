"""Solving rigs from projected corners, with truth at hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from calibration_worlds import boards, disturbed, sightings_of

from facetcam.calibration import lens
from facetcam.calibration.boards import BoardSet
from facetcam.calibration.difference import projection_difference, room_points
from facetcam.calibration.free_optics import FreeOptics
from facetcam.calibration.least_squares import normal_equations
from facetcam.calibration.optics import MirrorOptics
from facetcam.calibration.problem import Looks, State
from facetcam.calibration.sightings import Sighting
from facetcam.calibration.solve import solve
from facetcam.errors import FacetcamError
from facetcam.geometry import se3
from facetcam.rig import Camera, Mirror, Rig, presets
from facetcam.rig.camera import BROWN_CONRADY, KANNALA_BRANDT

BROWN = Camera(BROWN_CONRADY, 1600, 1200, 1240.0, 1250.0, 803.0, 590.0, (-0.1, 0.03, 3e-4, -2e-4, 0.004))
FISHEYE = Camera(KANNALA_BRANDT, 1600, 1200, 500.0, 505.0, 803.0, 590.0, (-0.02, 0.004, -1e-3, 2e-4))


@pytest.mark.parametrize("camera", [BROWN, FISHEYE])
def test_lens_projects_as_the_rig_does(camera: Camera) -> None:
    points = np.random.default_rng(0).uniform((-0.6, -0.4, 1.0), (0.6, 0.4, 3.0), (200, 3))
    expected, valid = camera.project(points)
    assert valid.all()
    np.testing.assert_allclose(
        lens.project(camera.model, lens.values_of(camera), points), expected, atol=1e-8
    )


@pytest.mark.parametrize("camera", [BROWN, FISHEYE])
@pytest.mark.parametrize("free", [False, True])
def test_normal_equations_are_those_of_finite_differences(camera: Camera, free: bool) -> None:
    state, looks = _small_problem(camera, free)
    normal = normal_equations(state, looks, np.ones(len(looks.pixels)))
    columns, stations = state.shared, len(state.T_rig_station)
    size = np.full(columns + 6 * stations, 1e-6)
    size[: len(state.intrinsics)] = 1e-2  # pixels are linear in them

    def moved(step: np.ndarray) -> np.ndarray:
        return state.moved(step[:columns], step[columns:].reshape(-1, 6)).predict(looks).reshape(-1)

    J = np.stack([(moved(s) - moved(-s)) / (2 * s.max()) for s in np.diag(size)], axis=1)
    H = J.T @ J
    scale = np.sqrt(np.outer(np.diag(H), np.diag(H))) + 1e-12
    assert np.abs((normal.A - H[:columns, :columns]) / scale[:columns, :columns]).max() < 1e-6
    for p in range(stations):
        own = slice(columns + 6 * p, columns + 6 * p + 6)
        assert np.abs((normal.B[p] - H[:columns, own]) / scale[:columns, own]).max() < 1e-6
        assert np.abs((normal.C[p] - H[own, own]) / scale[own, own]).max() < 1e-6


def _small_problem(camera: Camera, free: bool) -> tuple[State, Looks]:
    """Two views of `table`, one in both mirrors; boards and stations at arbitrary places."""
    random = np.random.default_rng(3)
    rig = presets.table()
    views = ("left", "left_right", "direct")
    optics: MirrorOptics | FreeOptics = MirrorOptics.of(rig, views, 0.05, 0.005)
    optics = optics.moved(0.01 * random.standard_normal(6))
    if free:
        optics = FreeOptics.of([se3.inverse(rig.T_rig_image(v)) for v in views])
    boards_at = np.array([se3.exp(0.1 * random.standard_normal(6)) for _ in range(2)])
    stations = np.array([se3.exp(0.05 * random.standard_normal(6)) for _ in range(2)])
    state = State(camera.model, lens.values_of(camera), optics, boards_at, stations)
    points = [random.uniform(-0.1, 0.1, (n, 3)) for n in (4, 6, 5, 3)]
    looks = Looks.of([p[:, :2] for p in points], points, [0, 1, 2, 1], [0, 1, 1, 0], [0, 0, 1, 1])
    return state, looks


def _bent(rig: Rig) -> Rig:
    return replace(rig, camera=replace(rig.camera, distortion=(-0.1, 0.03, 2e-4, -3e-4, 0.0)))


def _straight(rig: Rig) -> Rig:
    return replace(rig, camera=replace(rig.camera, distortion=(0.0,) * len(rig.camera.distortion)))


@pytest.mark.parametrize("seed", [0])
def test_solves_a_folded_rig_from_a_drawing_that_is_off(seed: int) -> None:
    rig, set = _bent(presets.ryu()), boards(8, True)
    sightings = sightings_of(rig, set, 20, 0.1, seed)
    result = solve(_straight(disturbed(rig, 3.0, 0.005, 0.1, seed)), set, sightings)
    assert result.noise == pytest.approx(0.1, rel=0.05)
    assert result.rms() == pytest.approx(0.1 * np.sqrt(2), rel=0.1)
    assert projection_difference(rig, result.rig, room_points(rig, list(rig.views), 200)).rms < 0.3
    assert [u.mirrors for u in result.unobservable] == [("base",)]


def test_says_that_views_seen_alone_cannot_be_tied() -> None:
    whole, set = presets.ryu(), boards(1, True)
    rig = replace(whole, views={name: view for name, view in whole.views.items() if name != "left"})
    seen: dict[int, Sighting] = {}
    for s in sightings_of(rig, set, 12, 0.1, 1):  # one sighting a photo: no photo ties two views
        seen.setdefault(s.photo, s)
    result = solve(rig, set, list(seen.values()))
    alone = [u for u in result.unobservable if "alone" in u.what]
    assert {m for u in alone for m in u.mirrors} == {s.view for s in result.fit.sightings}
    assert all("two boards at once" in u.advice and "fixed" not in u.advice for u in alone)
    assert [u.mirrors for u in result.unobservable if "in no view" in u.what] == [("left",)]
    sigma = dict(zip(result.parameters.names, result.parameters.sigma))
    assert all(np.isnan(sigma[f"{u.mirrors[0]}: tilt u"]) for u in alone)


def test_loose_boards_of_views_seen_alone_may_be_fixed() -> None:
    set = boards(4, False)
    seen: dict[tuple[int, int], Sighting] = {}
    for s in sightings_of(presets.ryu(), set, 12, 0.1, 1):  # every board in one view of a photo
        seen.setdefault((s.photo, s.board), s)
    result = solve(presets.ryu(), set, list(seen.values()))
    alone = [u for u in result.unobservable if "alone" in u.what]
    assert len(alone) == 4 and all("the same board in two views" in u.advice for u in alone)
    assert all("'fixed: true'" in u.advice for u in alone)


def flipped(sighting: Sighting, width: int) -> Sighting:
    """The sighting in a photo that was flipped left to right."""
    pixels = sighting.pixels * (-1.0, 1.0) + (width - 1.0, 0.0)
    return replace(sighting, pixels=pixels, mirrored=not sighting.mirrored)


def test_photos_that_were_flipped_are_told() -> None:
    rig, set = presets.ryu(), boards(8, True)
    sightings = sightings_of(rig, set, 12, 0.1)
    with pytest.raises(
        FacetcamError, match=r"an even number of mirrors, the photos show mirror images; were"
    ):
        solve(rig, set, [flipped(s, rig.size[0]) for s in sightings])
    some = {s.photo for s in sightings if s.photo % 5 == 2}
    result = solve(rig, set, [flipped(s, rig.size[0]) if s.photo in some else s for s in sightings])
    rejected = [f for f in result.findings if f.kind == "photo rejected"]
    assert len(some) > 1 and [f.photos for f in rejected] == [tuple(sorted(some))]
    assert not [f for f in solve(rig, set, sightings).findings if f.kind == "photo rejected"]


def test_refuses_sightings_that_give_no_pose() -> None:
    set = boards(1, True)
    line = Sighting(0, 0, np.arange(5), np.stack([np.arange(5) * 30.0, np.zeros(5)], axis=1), False)
    with pytest.raises(FacetcamError, match="span an area"):
        solve(presets.ryu(), BoardSet(set.boards, True), [line])


def test_rigs_in_other_frames_are_compared() -> None:
    rig = presets.ryu()
    T = se3.exp(np.array([0.3, -0.8, 1.9, 0.4, -0.2, 0.6]))
    mirrors = {
        name: Mirror.from_polygon(name, se3.transform(T, m.polygon)) for name, m in rig.mirrors.items()
    }
    other = replace(rig, T_rig_cam=T @ rig.T_rig_cam, mirrors=mirrors)
    points = room_points(rig, list(rig.views), 50)
    assert projection_difference(rig, other, points).rms < 1e-6
    assert projection_difference(rig, other, points, align=False).rms > 10.0
