"""What a finished map says of its rig: worlds seen by one rig and mapped with another."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from slam_worlds import folded, mapped, pyramid, winding_path

from facetcam.evaluation.trajectory import scale_error
from facetcam.rig import Rig
from facetcam.rig.freedom import moved, tolerance
from facetcam.slam.adjustment import Adjuster
from facetcam.slam.config import SlamConfig
from facetcam.slam.optics import Optics
from facetcam.slam.rig_audit import RigAudit, audit_rig

RIGS = {"folded": folded(), "pyramid": pyramid()}
CONFIG = SlamConfig()


def focal(rig: Rig, factor: float) -> Rig:
    camera = rig.camera
    return replace(rig, camera=replace(camera, fx=factor * camera.fx, fy=factor * camera.fy))


def audited(true: Rig, judged: Rig, seed: int) -> tuple[RigAudit, float, float]:
    """The audit of one rig on the map of what another saw, sigma and error of that map's scale."""
    rng, optics, path = np.random.default_rng(seed), Optics(judged, 8.0), winding_path(12, 1.5)
    world = mapped(true, optics, path, rng, 0.2)
    adjuster = Adjuster(world, optics, CONFIG)
    adjuster.adjust_all(last=True)
    before = world.poses()
    found = audit_rig(optics, adjuster, CONFIG.pixel_sigma)
    np.testing.assert_array_equal(world.poses(), before)  # it leaves all as it is
    assert found is not None
    return found, adjuster.judge(), scale_error(world.poses()[:, :3, 3], path[:, :3, 3])


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", RIGS)
def test_a_true_rig_is_not_denied(name: str, seed: int) -> None:
    found, *_ = audited(RIGS[name], RIGS[name], seed)
    assert not found.denies
    assert found.complaint == ""


@pytest.mark.parametrize("factor", [0.97, 1.03])
@pytest.mark.parametrize("name", RIGS)
def test_another_focal_length_is_denied(name: str, factor: float) -> None:
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
        found, exact, error = audited(replace(built, covariance=None), rig, seed)
        assert found.drawn_sigma is not None and found.drawn_sigma > 3.0 * exact
        off.append(error / found.drawn_sigma)
    assert np.abs(off).max() < 3.0
    assert np.sqrt(np.mean(np.square(off))) > 0.2


def test_a_calibrated_rig_is_no_drawing() -> None:
    rig = RIGS["folded"]
    known = tolerance(rig)
    calibrated = replace(rig, covariance=replace(known, matrix=0.01 * known.matrix))
    assert audited(rig, calibrated, 5)[0].drawn_sigma is None
