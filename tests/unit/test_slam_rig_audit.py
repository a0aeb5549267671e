"""What a finished map says of its rig: worlds seen by one rig and mapped with another."""

from __future__ import annotations

from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest
from slam_worlds import folded, mapped, pyramid, winding_path

from facetcam.evaluation.trajectory import scale_error
from facetcam.rig import Rig, RigCovariance
from facetcam.rig.covariance import GLASS
from facetcam.rig.freedom import moved, tolerance
from facetcam.rig.mirrors import Glass
from facetcam.slam.adjustment.adjuster import Adjuster
from facetcam.slam.adjustment.information import linearise_all, rig_derivatives
from facetcam.slam.camera.optics import Optics
from facetcam.slam.config import SlamConfig
from facetcam.slam.mapping.grower import Grower
from facetcam.slam.rig_check.audit import RigAudit, audit_rig, drawn_scale_sigma
from facetcam.slam.rig_check.check import RigCheck

RIGS = {"folded": folded(), "pyramid": pyramid()}
CONFIG = SlamConfig()


def focal(rig: Rig, factor: float) -> Rig:
    camera = rig.camera
    return replace(rig, camera=replace(camera, fx=factor * camera.fx, fy=factor * camera.fy))


def audited(true: Rig, judged: Rig, seed: int) -> tuple[RigAudit, float | None, float, float]:
    """The audit of one rig on the map of what another saw; sigmas (drawn, exact) and error of its scale."""
    rng, optics, path = np.random.default_rng(seed), Optics(judged, 8.0), winding_path(12, 1.5)
    world = mapped(true, optics, path, rng, 0.2)
    adjuster = Adjuster(world, optics, CONFIG)
    adjuster.adjust_all(last=True)
    before = world.poses()
    found = audit_rig(optics, adjuster, CONFIG.pixel_sigma)
    drawn = drawn_scale_sigma(optics, adjuster, CONFIG.pixel_sigma)
    np.testing.assert_array_equal(world.poses(), before)  # it leaves all as it is
    assert found is not None
    return found, drawn, adjuster.judge(), scale_error(world.poses()[:, :3, 3], path[:, :3, 3])


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", RIGS)
def test_a_true_rig_is_not_denied(name: str, seed: int) -> None:
    found, *_ = audited(RIGS[name], RIGS[name], seed)
    assert not found.denies
    assert found.complaint == ""


@pytest.mark.parametrize(
    ("name", "factors"), [("folded", (0.97, 0.99, 1.01, 1.03)), ("pyramid", (0.97, 1.03))]
)
def test_another_focal_length_is_denied(name: str, factors: tuple[float, ...]) -> None:
    for factor in factors:
        found, *_ = audited(RIGS[name], focal(RIGS[name], factor), 4)
        assert found.denies
        assert "facetcam calibrate" in found.complaint


@pytest.mark.parametrize("name", RIGS)
def test_the_scale_of_a_drawing_is_as_wrong_as_is_said(name: str) -> None:
    """Eight rigs built with care after one drawing: errors of the scale by what is said of them."""
    rig, rng = RIGS[name], np.random.default_rng(8)
    open_ = tolerance(rig)
    off = []
    for seed in range(8):
        built = moved(rig, open_, rng.multivariate_normal(np.zeros(len(open_.matrix)), open_.matrix))
        _, drawn, exact, error = audited(replace(built, covariance=None), rig, seed)
        assert drawn is not None and drawn > 3.0 * exact
        off.append(error / drawn)
    assert np.abs(off).max() < 3.0
    assert np.sqrt(np.mean(np.square(off))) > 0.2


def test_a_calibrated_rig_is_no_drawing() -> None:
    rig = RIGS["folded"]
    known = tolerance(rig)
    calibrated = replace(rig, covariance=replace(known, matrix=0.01 * known.matrix))
    assert audited(rig, calibrated, 5)[1] is None


@pytest.mark.parametrize("name", RIGS)
def test_what_a_file_leaves_open_is_not_denied(name: str) -> None:
    """The sigma of the scale covers it instead."""
    rig = RIGS[name]
    drawn = replace(focal(rig, 0.99), covariance=tolerance(rig))
    found, _, sigma, error = audited(rig, drawn, 6)
    assert not found.denies
    assert abs(error) < 3.0 * sigma


@pytest.mark.parametrize(("factor", "denied"), [(1.0, False), (0.99, True)])
def test_the_rig_is_asked_whenever_the_whole_map_is_adjusted(factor: float, denied: bool) -> None:
    rig, path = RIGS["folded"], winding_path(12, 1.5)
    optics = Optics(focal(rig, factor), 8.0)
    world = mapped(rig, optics, path, np.random.default_rng(7), 0.2)
    adjuster, check, nothing = Adjuster(world, optics, CONFIG), RigCheck(optics, CONFIG, Mock()), Mock()
    nothing.handovers.evidence().tested = lambda sigma, _: sigma
    nothing.ends_in_a_loop.return_value = False
    grower = Grower(world, nothing, nothing, adjuster, nothing, check, optics, CONFIG)
    grower.adjust_all(last=True)
    assert grower.metric
    assert check.fits != denied
    assert bool(check.complaint) == denied
    assert check.moves_as_one  # the run goes on, without a metre
    nothing.handovers.evidence().tested = lambda *_: np.inf
    grower.adjust_all()
    assert check.fits  # a map without a scale says nothing of the rig


def with_glass(rig: Rig) -> tuple[Rig, RigCovariance]:
    """A rig whose mirrors have their silver behind glass, of which thickness and index are open, too."""
    known = tolerance(rig)
    open_ = [f"{name}: {word}" for name in known.axes for word in GLASS]
    sigma = np.concatenate([np.sqrt(np.diag(known.matrix)), np.tile([1e-4, 0.01], len(known.axes))])
    rig = replace(rig, mirrors={n: replace(m, glass=Glass(0.003, 1.52)) for n, m in rig.mirrors.items()})
    return rig, RigCovariance((*known.parameters, *open_), np.diag(sigma**2), known.axes)


@pytest.mark.parametrize("glass", [False, True])
@pytest.mark.parametrize("name", RIGS)
def test_derivatives_by_the_rig_are_the_slope_of_the_residuals(name: str, glass: bool) -> None:
    """Whole rigs are moved for it, with their mirrors, virtual cameras and ideal pinholes."""
    rig, known = with_glass(RIGS[name]) if glass else (RIGS[name], tolerance(RIGS[name]))
    optics, path = Optics(rig, 8.0), winding_path(4, 0.5)
    whole = Adjuster(mapped(rig, optics, path, np.random.default_rng(9), 0.2), optics, CONFIG).whole()
    assert whole is not None
    xyz, pixels = whole.points[whole.point], optics.pixels(whole.plane, whole.view)
    found = rig_derivatives(whole, linearise_all(whole, xyz, optics)[1], optics, known)
    for index, sigma in enumerate(np.sqrt(np.diag(known.matrix))):
        residuals = []
        for step in (0.05 * sigma, -0.05 * sigma):
            other = optics.adapted(moved(rig, known, step * np.eye(len(known.parameters))[index]))
            seen = replace(whole, plane=other.plane(pixels, whole.view))
            residuals.append(linearise_all(seen, xyz, other)[0])
        slope = (residuals[0] - residuals[1]) / 0.1
        assert np.abs(slope).max() > 1e-3
        np.testing.assert_allclose(found[:, :, index], slope, atol=0.03 * np.abs(slope).max())


@pytest.mark.parametrize(
    ("gain", "moved", "denies"),
    [
        (6.2, 2.7, True),
        (6.2, 1.3, False),
        (4.5, 2.7, False),
        (7.5, 0.6, True),
        (7.5, 0.4, False),
        (9.5, 0.1, True),
    ],
)
def test_what_moves_farther_than_any_true_rig_needs_less_gain(
    gain: float, moved: float, denies: bool
) -> None:
    """As seen of a lens wrong by 3 %: between two judgements that denied it the gain fell to 6.2."""
    assert RigAudit({"fx": 0.1, "fy": -moved}, gain).denies == denies
