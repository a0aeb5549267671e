"""Rolling shutter: frames whose rows were seen while the rig moved on, row by row."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from slam_worlds import bundle_of, folded, in_sight, winding_path

from facetcam.geometry import se3
from facetcam.slam.adjustment.bundle import Bundle, adjust
from facetcam.slam.adjustment.map_uncertainty import free_frames
from facetcam.slam.camera.frame import Corners
from facetcam.slam.camera.nuisances import Nuisances
from facetcam.slam.camera.optics import Optics
from facetcam.slam.camera.shutter import sweep
from facetcam.slam.map.map import Keyframe
from facetcam.slam.map.trajectory import Trajectory

STEP = 0.2  # seconds between frames
SIGMA = 0.2  # px


def velocities(path: np.ndarray) -> np.ndarray:
    there = [se3.log(se3.inverse(a) @ b) / (2 * STEP) for a, b in zip(path[:-2], path[2:])]
    return np.stack([there[0], *there, there[-1]])


def rolled(exact: Bundle, path: np.ndarray, optics: Optics, readout: float) -> np.ndarray:
    """Where each observation falls when its row is read in its turn, posed one by one."""
    v = velocities(path)
    height = optics.camera.height
    plane = exact.plane.copy()
    for i, (k, view) in enumerate(zip(exact.frame, exact.view)):
        for _ in range(3):  # the row depends on where the point is seen by then
            row = optics.pixels(plane[i : i + 1], np.array([view]))[0, 1]
            T = path[k] @ se3.exp((row / (height - 1) - 0.5) * readout * v[k])
            local = se3.transform(se3.inverse(T), exact.points[exact.point[i]][None])
            plane[i] = optics.to_plane(local, np.array([view]))[0]
    return plane


def swept(bundle: Bundle, path: np.ndarray, optics: Optics, pixels: np.ndarray) -> np.ndarray:
    out, v = np.zeros_like(bundle.plane), velocities(path)
    for k, T in enumerate(bundle.T_world_rig):
        rows = bundle.frame == k
        xyz = bundle.points[bundle.point[rows]]
        out[rows] = sweep(T, v[k], xyz, bundle.view[rows], pixels[rows], optics)
    return out


@pytest.mark.parametrize("readout", [0.0, 0.012, -0.02])
def test_the_readout_is_estimated_and_no_longer_spoils_the_path(readout: float) -> None:
    optics, rng = Optics(folded(), 8.0), np.random.default_rng(5)
    path = winding_path(6, 1.2)
    exact = bundle_of(optics, path, in_sight(optics, path, rng, 250))
    seen = rolled(exact, path, optics, readout) + rng.normal(0.0, SIGMA, exact.plane.shape)
    pixels = optics.pixels(seen, exact.view)
    bundle, estimate, errors = replace(exact, plane=seen), 0.0, []
    for _ in range(3):
        poses, points, found = adjust(bundle, optics, 10.0 * SIGMA, 100, 1e-10, 0, SIGMA)
        estimate = float(found[0]) if len(found) else 0.0
        errors.append(float(np.linalg.norm(poses[:, :3, 3] - path[:, :3, 3], axis=1).max()))
        bundle = replace(bundle, T_world_rig=poses, points=points)
        motion = swept(bundle, path, optics, pixels)
        rolls = Nuisances.of(estimate, np.zeros(2), motion, None)
        bundle = replace(bundle, plane=seen - estimate * motion, nuisances=rolls)
    assert abs(estimate - readout) < 0.001
    assert errors[-1] < (0.4 if readout else 1.5) * errors[0]


def test_an_unknown_readout_makes_the_path_less_sure() -> None:
    optics, rng = Optics(folded(), 8.0), np.random.default_rng(6)
    path = winding_path(4)
    bundle = bundle_of(optics, path, in_sight(optics, path, rng, 400))
    known = free_frames(bundle, optics, SIGMA).covariance
    motion = swept(bundle, path, optics, optics.pixels(bundle.plane, bundle.view))
    bundle.nuisances = Nuisances.of(0.0, np.zeros(2), motion, None)
    left = free_frames(bundle, optics, SIGMA).covariance
    assert all(np.linalg.eigvalsh(b - a).min() > -1e-9 * np.trace(b) for a, b in zip(known, left))
    assert np.trace(left[-1]) > 1.001 * np.trace(known[-1])


def test_a_frame_moves_as_its_neighbours_in_time_say() -> None:
    keyframe = Keyframe(0, 0.0, np.eye(4), Corners.none(), None, None)
    twist = np.array([0.0, 0.1, 0.3, 0.1, 0.7, 0.0])
    trajectory = Trajectory()
    for t in (0.0, 0.1, 0.2, 2.0):
        trajectory.add(t, se3.exp(t * twist), keyframe)
    for t in (0.0, 0.1, 0.2):
        assert np.allclose(trajectory.velocity(t), twist)
    assert not trajectory.velocity(2.0).any()
    keyframe.velocity = twist.copy()
    keyframe.grow(2.0)
    assert np.allclose(keyframe.velocity, [*twist[:3], *(2.0 * twist[3:])])
