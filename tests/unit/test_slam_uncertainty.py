"""Covariance of poses against what random errors do, drawn and composed one by one."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from slam_worlds import bundle_of, folded, in_sight, winding_path
from threadpoolctl import threadpool_limits

from facetcam.geometry import se3
from facetcam.slam.adjustment.information import information
from facetcam.slam.adjustment.map_uncertainty import free_frames, map_uncertainty
from facetcam.slam.camera.frame import Corners
from facetcam.slam.camera.optics import Optics
from facetcam.slam.map.map import Keyframe
from facetcam.slam.tracking.uncertainty import TOGETHER, drift_of, pose_covariance, reckoned_covariance

STEP = np.diag([0.01, 0.01, 0.02, 0.05, 0.05, 0.02]) ** 2
MOVED = se3.exp([0.1, -0.2, 0.7, 0.4, 1.2, 0.1])


def keyframe(T: np.ndarray, covariance: np.ndarray | None) -> Keyframe:
    corners = Corners.none()
    return Keyframe(0, 0.0, T, corners, None, None, covariance=covariance)


def test_adjoint_moves_a_twist_through_a_pose() -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        xi = rng.normal(0.0, 0.5, 6)
        assert np.allclose(MOVED @ se3.exp(xi), se3.exp(se3.adjoint(MOVED) @ xi) @ MOVED)


def test_dead_reckoning_grows_as_composed_errors_do() -> None:
    rng = np.random.default_rng(4)
    before = 0.5 * STEP
    ends = []
    for _ in range(4000):
        wrong_start = se3.exp(rng.multivariate_normal(np.zeros(6), before))
        wrong_step = MOVED @ se3.exp(rng.multivariate_normal(np.zeros(6), STEP))
        ends.append(se3.log(se3.inverse(MOVED) @ wrong_start @ wrong_step))
    found = reckoned_covariance(before, MOVED, STEP)
    drawn = np.cov(np.array(ends).T)
    assert np.allclose(np.diag(drawn), np.diag(found), rtol=0.15)


def test_what_poses_lack_adds_up_until_the_map_is_judged() -> None:
    rng, way = np.random.default_rng(5), [np.eye(4)]
    for _ in range(4):
        way.append(way[-1] @ MOVED)
    chain = [keyframe(way[0], 0.5 * STEP)] + [keyframe(T, None) for T in way[1:]]
    for before, new in pairwise(chain):
        new.drift = drift_of(new, STEP, before)
    ends = []
    for _ in range(4000):
        T = way[0] @ se3.exp(rng.multivariate_normal(np.zeros(6), 0.5 * STEP))
        for _ in way[1:]:
            T = T @ MOVED @ se3.exp(rng.multivariate_normal(np.zeros(6), STEP))
        ends.append(se3.log(se3.inverse(way[-1]) @ T))
    live = pose_covariance(way[-1], np.zeros((6, 6)), chain[::-1], 0.0, wheels=True) / TOGETHER
    assert np.allclose(np.diag(np.cov(np.array(ends).T)), np.diag(live), rtol=0.15)
    chain[-1].covariance = STEP
    judged = pose_covariance(way[-1], np.zeros((6, 6)), chain[::-1], 0.0, wheels=True) / TOGETHER
    assert np.allclose(judged, STEP)


def test_an_unknown_scale_leaves_the_length_of_the_way_open() -> None:
    start = keyframe(np.eye(4), None)
    ahead = se3.exp([0, 0, 0, 0.0, 2.0, 0.0])
    unknown = pose_covariance(ahead, 1e-6 * np.eye(6), [start], np.inf, wheels=False)
    rolled = pose_covariance(ahead, 1e-6 * np.eye(6), [start], np.inf, wheels=True)
    known = keyframe(np.eye(4), np.zeros((6, 6)))
    judged = pose_covariance(ahead, 1e-6 * np.eye(6), [known], 0.01, wheels=True)
    lengths = [float(np.sqrt(c[4, 4])) for c in (unknown, rolled, judged)]
    turns = [1e3 * float(np.sqrt(c[2, 2] - TOGETHER * 1e-6)) for c in (unknown, rolled, judged)]
    assert lengths[0] > 4.0  # three times too small is within one sigma, nine times within four
    assert 2.0 > lengths[1] > 0.6 > 0.1 > lengths[2] > 0.02
    assert turns[0] > 2.5 > 1.0 > turns[1] > 0.1 > turns[2]  # milliradians, by which a wrong scale bends


def test_covariance_of_frames_grows_away_from_the_held_one_and_with_the_noise() -> None:
    optics, rng = Optics(folded(), 8.0), np.random.default_rng(7)
    path = winding_path(4)
    points = in_sight(optics, path, rng, 1200)
    noise = rng.normal(0.0, 0.5, (20000, 2))
    found = map_uncertainty(bundle_of(optics, path, points, noise), optics, 0.5).covariance
    assert np.all(found[0] == 0.0)
    for earlier, later in pairwise(found[1:]):
        assert np.trace(later[3:, 3:]) > np.trace(earlier[3:, 3:]) > 0.0  # farther from the held frame
        assert np.linalg.eigvalsh(later).min() > 0.0
    doubled = map_uncertainty(bundle_of(optics, path, points, 2.0 * noise), optics, 1.0).covariance
    assert np.allclose(doubled[-1], 4.0 * found[-1], rtol=0.1)


def test_what_is_open_against_several_held_frames_is_the_conditional_covariance() -> None:
    optics, rng = Optics(folded(), 8.0), np.random.default_rng(8)
    path = winding_path(5)
    bundle = bundle_of(optics, path, in_sight(optics, path, rng, 600), rng.normal(0.0, 0.5, (20000, 2)))
    bundle.fixed = np.arange(5) < 1
    half = free_frames(bundle, optics, 0.5).spread
    joint = half @ half.T
    held, free = slice(0, 12), slice(12, 24)
    left = joint[free, free] - joint[free, held] @ np.linalg.solve(joint[held, held], joint[held, free])
    bundle.fixed = np.arange(5) < 3
    found = free_frames(bundle, optics, 0.5).covariance
    assert np.allclose(found[0], left[:6, :6], rtol=1e-3, atol=1e-3 * np.abs(left).max())
    assert np.allclose(found[1], left[6:, 6:], rtol=1e-3, atol=1e-3 * np.abs(left).max())


def test_uncertainty_is_alike_to_the_bit_whatever_the_threads_of_linear_algebra() -> None:
    optics, rng = Optics(folded(), 8.0), np.random.default_rng(11)
    path = winding_path(30)
    points, noise = in_sight(optics, path, rng, 900), rng.normal(0.0, 0.5, (100_000, 2))
    bundle, found = bundle_of(optics, path, points, noise), []
    for threads in (1, 2, 3):
        with threadpool_limits(threads, "blas"):
            found.append(map_uncertainty(bundle, optics, 0.5))
    for other in found[1:]:
        assert other.scale_sigma == found[0].scale_sigma
        assert np.array_equal(other.covariance, found[0].covariance)


def test_a_point_close_by_that_is_seen_once_tells_nothing() -> None:
    """Its ray alone is known, to the digit: what rounding loses of that must not pose as information."""
    optics, rng = Optics(folded(), 8.0), np.random.default_rng(12)
    path = winding_path(5)
    bundle = bundle_of(optics, path, in_sight(optics, path, rng, 300), rng.normal(0.0, 0.01, (20000, 2)))
    last, plane = len(path) - 1, np.array([[-9.6, -13.2]])
    for depth in (0.15, 0.02):
        ray = optics.plane_rays(plane, np.array([0])) * depth
        point = se3.transform(path[last], optics.origins(np.array([0])) + ray)
        more = replace(
            bundle,
            points=np.concatenate([bundle.points, point]),
            frame=np.append(bundle.frame, last),
            view=np.append(bundle.view, 0),
            point=np.append(bundle.point, len(bundle.points)),
            plane=np.concatenate([bundle.plane, plane]),
        )
        without, with_it = (information(b, optics, 0.5).poses for b in (bundle, more))
        scales = [np.linalg.eigvalsh(S / np.trace(S))[6:] for S in (without, with_it)]
        assert np.allclose(scales[1], scales[0], rtol=1e-3)
