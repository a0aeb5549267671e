"""Refining a rig from its own map: worlds seen by one rig and mapped with another."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from slam_worlds import folded, mapped, pyramid, winding_path

from facetcam.evaluation.trajectory import scale_error
from facetcam.rig.freedom import moved, tolerance
from facetcam.slam.adjustment.adjuster import Adjuster
from facetcam.slam.camera.optics import Optics
from facetcam.slam.config import SlamConfig
from facetcam.slam.map.map import Map
from facetcam.slam.rig_check.audit import RigAudit
from facetcam.slam.rig_check.check import RigCheck
from facetcam.slam.rig_check.refinement import refine_rig

Array = NDArray[np.float64]

RIGS = {"folded": folded(), "pyramid": pyramid()}
CONFIG = SlamConfig()


def centres(world: Map) -> Array:
    return world.poses()[:, :3, 3]


@pytest.mark.parametrize("name", RIGS)
def test_a_rig_a_little_off_is_found_and_its_metre_with_it(name: str) -> None:
    rig, rng = RIGS[name], np.random.default_rng(5)
    known = tolerance(rig)
    sigma = 0.1 * np.sqrt(np.diag(known.matrix))  # tilts of two arc minutes, shifts of 0.03 mm
    known = replace(known, matrix=0.01 * known.matrix)
    true = moved(rig, known, sigma * rng.standard_normal(len(sigma)))
    judged = replace(rig, covariance=known)
    optics, path = Optics(judged, 8.0), winding_path(12, 1.5)
    world = mapped(true, optics, path, rng, 0.2)
    adjuster = Adjuster(world, optics, CONFIG)
    adjuster.adjust_all(last=True)
    before = abs(scale_error(centres(world), path[:, :3, 3]))
    found = refine_rig(world, optics, adjuster, CONFIG.pixel_sigma)
    after = abs(scale_error(centres(world), path[:, :3, 3]))
    assert found is not None and found.rig.covariance is not None
    assert after < 0.5 * before
    assert after < 3.0 * adjuster.judge()
    assert np.abs(found.shift).max() < 4.0
    assert not found.complaint
    assert np.all(np.diag(found.rig.covariance.matrix) < 1.001 * np.diag(known.matrix))


def test_a_true_rig_stays_true() -> None:
    rig, rng = RIGS["pyramid"], np.random.default_rng(6)
    known = tolerance(rig)
    rig = replace(rig, covariance=replace(known, matrix=0.01 * known.matrix))
    optics, path = Optics(rig, 8.0), winding_path(8, 1.5)
    world = mapped(rig, optics, path, rng, 0.2)
    adjuster = Adjuster(world, optics, CONFIG)
    adjuster.adjust_all(last=True)
    unsure = adjuster.judge()
    found = refine_rig(world, optics, adjuster, CONFIG.pixel_sigma)
    assert found is not None
    assert np.abs(found.shift).max() < 1.0
    assert adjuster.judge() < unsure
    assert abs(scale_error(centres(world), path[:, :3, 3])) < 3.0 * adjuster.judge()


def test_a_map_too_small_refines_nothing() -> None:
    optics, path = Optics(RIGS["pyramid"], 8.0), winding_path(3, 0.3)
    world = mapped(optics.rig, optics, path, np.random.default_rng(7), 0.2)
    assert refine_rig(world, optics, Adjuster(world, optics, CONFIG), CONFIG.pixel_sigma) is None
    assert optics.rig is RIGS["pyramid"]


def test_a_rig_that_is_nothing_like_its_file_proves_no_metre() -> None:
    """A lens 5 % longer than one that was said to be known to half a per cent."""
    rig, rng = RIGS["pyramid"], np.random.default_rng(8)
    known = tolerance(rig)
    sigma = np.sqrt(np.diag(known.matrix)) * [10.0 * (name in ("fx", "fy")) for name in known.parameters]
    true, optics, path = moved(rig, known, sigma), Optics(rig, 8.0), winding_path(10, 1.5)
    world = mapped(true, optics, path, rng, 0.2)
    adjuster = Adjuster(world, optics, CONFIG)
    adjuster.adjust_all(last=True)
    found = refine_rig(world, optics, adjuster, CONFIG.pixel_sigma)
    assert found is not None
    assert "standard deviations" in found.complaint and "facetcam calibrate" in found.complaint
    check = RigCheck(optics, CONFIG, lambda frame: None)  # type: ignore[arg-type]
    assert check.fits
    check.refinement = found
    assert not check.fits
    assert check.complaint == found.complaint
    check.audit = RigAudit({"fx": 10.0}, gain=50.0)  # of the rig before
    check.refinement = replace(found, shift=0.1 * found.shift)
    assert check.fits and not check.complaint
