"""Creep: a camera that has moved against its mirrors since its rig was calibrated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from slam_worlds import bundle_of, folded, in_sight, winding_path

from facetcam.rig import Rig
from facetcam.slam.adjustment.bundle import adjust
from facetcam.slam.adjustment.map_uncertainty import free_frames, map_uncertainty
from facetcam.slam.camera.nuisances import Nuisances, believed, shift_by_creep
from facetcam.slam.camera.optics import Optics

SIGMA = 0.2  # px


def crept(rig: Rig, creep: tuple[float, float]) -> Rig:
    """The rig as its camera stands now."""
    x, y = creep
    return replace(rig, camera=replace(rig.camera, cx=rig.camera.cx + x, cy=rig.camera.cy + y))


@pytest.mark.parametrize("creep", [(0.0, 0.0), (0.3, -0.6), (-1.2, 0.5)])
def test_the_creep_is_estimated_and_no_longer_spoils_the_path(creep: tuple[float, float]) -> None:
    rng, path = np.random.default_rng(7), winding_path(6, 1.2)
    now, filed = Optics(crept(folded(), creep), 8.0), Optics(folded(), 8.0)
    exact = bundle_of(now, path, in_sight(now, path, rng, 400))
    pixels = now.pixels(exact.plane, exact.view) + rng.normal(0.0, SIGMA, exact.plane.shape)
    held = replace(exact, plane=filed.plane(pixels, exact.view))
    shift = shift_by_creep(held.plane, held.view, filed)
    free = replace(held, nuisances=Nuisances.of(0.0, np.zeros(2), np.zeros_like(held.plane), shift))
    (before, *_), (poses, points, found) = (
        adjust(b, filed, 10.0 * SIGMA, 100, 1e-10, 0, SIGMA) for b in (held, free)
    )
    errors = [np.linalg.norm(T[:, :3, 3] - path[:, :3, 3], axis=1).max() for T in (before, poses)]
    filed.creep_to(found[1:])
    free = replace(free, plane=filed.plane(pixels, exact.view), T_world_rig=poses, points=points)
    free.nuisances = Nuisances.of(0.0, found[1:], np.zeros_like(held.plane), shift)
    left = free_frames(free, filed, 10.0 * SIGMA)
    sigma = np.sqrt(np.diag(left.nuisance_covariance)[1:])
    assert found[0] == 0.0 and np.all(np.abs(left.nuisance_step[1:]) < 0.5 * sigma)
    assert np.all(np.abs(found[1:] - creep) < 3.0 * sigma) and np.all(sigma < 0.2)
    assert errors[1] < (0.4 if any(creep) else 1.5) * errors[0]


def test_an_unknown_creep_makes_the_scale_less_sure() -> None:
    optics, rng, path = Optics(folded(), 8.0), np.random.default_rng(8), winding_path(4)
    bundle = bundle_of(optics, path, in_sight(optics, path, rng, 400))
    known = map_uncertainty(bundle, optics, SIGMA).scale_sigma
    shift = shift_by_creep(bundle.plane, bundle.view, optics)
    bundle.nuisances = Nuisances.of(0.0, np.zeros(2), np.zeros_like(bundle.plane), shift)
    assert known * 1.001 < map_uncertainty(bundle, optics, SIGMA).scale_sigma < np.inf


def test_a_shift_of_the_image_is_that_of_its_camera() -> None:
    optics, step = Optics(folded(), 8.0), 1e-3
    pixels = np.array([[400.0, 90.0], [90.0, 300.0], [700.0, 310.0], [420.0, 520.0]])
    view = optics.view_of(pixels)
    shift = shift_by_creep(optics.plane(pixels, view), view, optics)
    before = optics.plane(pixels, view)
    for way in np.eye(2):
        optics.creep_to(step * way)
        assert np.allclose((before - optics.plane(pixels, view)) / step, shift @ way, atol=2e-3)


def test_what_is_not_known_is_not_believed() -> None:
    told = np.diag([1e-3, 0.1, 0.1]) ** 2
    assert np.allclose(believed(np.array([0.01, 0.3, -0.2]), told), [0.01, 0.3, -0.2])
    assert np.allclose(believed(np.array([0.001, 0.3, -0.2]), told), [0.0, 0.3, -0.2])
    vague = np.diag([1e-3, 0.1, 0.4]) ** 2
    assert np.allclose(believed(np.array([0.01, 0.3, -0.2]), vague), [0.01, 0.0, 0.0])
    assert np.allclose(believed(np.array([0.01, 0.3, -9.0]), told), [0.01, 0.0, 0.0])
    assert np.allclose(believed(np.array([0.01]), told[:1, :1]), [0.01, 0.0, 0.0])
    mixed = told.copy()
    mixed[0, 1] = mixed[1, 0] = 0.9 * 1e-3 * 0.1
    assert believed(np.array([0.001, 0.3, 0.0]), mixed)[1] == pytest.approx(0.3 - 0.9 * 0.1 / 1e-3 * 0.001)
