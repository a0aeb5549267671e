"""Bundle adjustment and what it says of the metre, against exact worlds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from slam_worlds import bundle_of, folded, in_sight, single, winding_path

from facetcam.geometry import se3
from facetcam.slam.adjustment.bundle import Bundle, RelativePose, adjust
from facetcam.slam.adjustment.map_uncertainty import map_uncertainty
from facetcam.slam.camera.optics import Optics

Array = NDArray[np.float64]

PATH = winding_path(5)
LOOSE = np.diag([1.0, 1.0, 1.0, 0.01, 0.01, 0.01])


@pytest.fixture(scope="module")
def ryu() -> Optics:
    return Optics(folded(), 8.0)


@pytest.fixture(scope="module")
def central() -> Optics:
    return Optics(single(), 8.0)


def shaken(bundle: Bundle, rng: np.random.Generator, size: float) -> Bundle:
    """Free poses and points moved at random."""
    poses = bundle.T_world_rig.copy()
    for k in np.flatnonzero(~bundle.fixed):
        poses[k] = poses[k] @ se3.exp(size * rng.standard_normal(6))
    return replace(
        bundle, T_world_rig=poses, points=bundle.points + size * rng.standard_normal(bundle.points.shape)
    )


def solved(bundle: Bundle, optics: Optics) -> tuple[Array, Array]:
    return adjust(bundle, optics, 1.0, 100, 1e-12)[:2]


def test_exact_data_bring_poses_and_points_back(ryu: Optics) -> None:
    """The mirrors alone give the metre: only the first frame is held."""
    rng = np.random.default_rng(11)
    truth = bundle_of(ryu, PATH, in_sight(ryu, PATH, rng, 1200))
    start = shaken(truth, rng, 0.02)
    poses, points = solved(start, ryu)
    assert np.abs(start.T_world_rig - PATH).max() > 0.02
    np.testing.assert_allclose(poses, PATH, atol=1e-4)
    assert np.median(np.linalg.norm(points - truth.points, axis=1)) < 1e-4


def test_held_frames_stay_to_the_bit(ryu: Optics) -> None:
    rng = np.random.default_rng(12)
    truth = bundle_of(ryu, PATH, in_sight(ryu, PATH, rng, 800))
    truth.fixed[[0, 3]] = True
    start = shaken(truth, rng, 0.01)
    poses, _ = solved(start, ryu)
    assert np.array_equal(poses[[0, 3]], start.T_world_rig[[0, 3]])
    assert not np.array_equal(poses[1], start.T_world_rig[1])


def test_adjustment_keeps_rotations_proper_and_its_input_untouched(ryu: Optics) -> None:
    rng = np.random.default_rng(13)
    start = shaken(bundle_of(ryu, PATH, in_sight(ryu, PATH, rng, 800)), rng, 0.02)
    before = start.T_world_rig.copy(), start.points.copy()
    for T in solved(start, ryu)[0]:
        se3.assert_proper_rotation(T[:3, :3], tolerance=1e-9)
    assert np.array_equal(start.T_world_rig, before[0])
    assert np.array_equal(start.points, before[1])


def test_a_wrong_match_does_not_spoil_the_rest(ryu: Optics) -> None:
    rng = np.random.default_rng(14)
    truth = bundle_of(ryu, PATH, in_sight(ryu, PATH, rng, 1200))
    truth.plane[::20] += 60.0
    poses, _ = solved(shaken(truth, rng, 0.005), ryu)
    for T, true in zip(poses, PATH):
        twist = se3.log(se3.inverse(true) @ T)
        assert np.linalg.norm(twist[:3]) < 0.001
        assert np.linalg.norm(twist[3:]) < 0.01


def test_odometry_gives_one_central_camera_its_scale(central: Optics) -> None:
    """Images of one camera fit at any scale: the odometry's length decides."""
    path = winding_path(4, 0.8)
    truth = bundle_of(central, path, in_sight(central, path, np.random.default_rng(15), 2500))
    small = replace(truth, T_world_rig=path.copy(), points=0.7 * truth.points)
    small.T_world_rig[:, :3, 3] *= 0.7
    unmoved, _ = solved(small, central)
    np.testing.assert_allclose(unmoved, small.T_world_rig, atol=1e-3)
    small.motions = [
        RelativePose(k, k + 1, se3.inverse(path[k]) @ path[k + 1], 1e-4 * np.eye(6)) for k in range(3)
    ]
    poses, points = solved(small, central)
    np.testing.assert_allclose(poses, path, atol=5e-3)
    assert np.median(np.linalg.norm(points, axis=1) / np.linalg.norm(truth.points, axis=1)) == pytest.approx(
        1.0, abs=0.01
    )


def test_loose_odometry_does_not_bend_what_the_mirrors_tell(ryu: Optics) -> None:
    rng = np.random.default_rng(16)
    truth = bundle_of(ryu, PATH, in_sight(ryu, PATH, rng, 1200))
    step = se3.inverse(PATH[0]) @ PATH[-1]
    step[:3, 3] *= 1.3
    truth.motions = [RelativePose(0, len(PATH) - 1, step, LOOSE)]
    poses, _ = solved(shaken(truth, rng, 0.01), ryu)
    np.testing.assert_allclose(poses, PATH, atol=6e-3)  # the wheels say 0.3 m more


def test_one_central_camera_cannot_tell_the_scale(central: Optics) -> None:
    rng = np.random.default_rng(17)
    noise = rng.normal(0.0, 0.5, (20000, 2))
    assert (
        map_uncertainty(
            bundle_of(central, PATH, in_sight(central, PATH, rng, 2500), noise), central, 0.5
        ).scale_sigma
        == np.inf
    )


def test_a_rig_that_stands_cannot_tell_the_scale(ryu: Optics) -> None:
    still = np.repeat(PATH[:1], 4, axis=0)
    points = in_sight(ryu, PATH, np.random.default_rng(18), 1200)
    assert map_uncertainty(bundle_of(ryu, still, points), ryu, 0.5).scale_sigma == np.inf
    assert map_uncertainty(bundle_of(ryu, still[:1], points), ryu, 0.5).scale_sigma == np.inf


def test_a_few_points_in_a_second_view_prove_no_scale(ryu: Optics) -> None:
    """Wrong matches would, as surely as right ones."""
    rng = np.random.default_rng(34)
    whole = bundle_of(ryu, PATH, in_sight(ryu, PATH, rng, 3000), rng.normal(0.0, 0.5, (40000, 2)))
    for n_beside, known in ((20, False), (200, True)):
        beside = np.isin(whole.point, np.unique(whole.point[whole.view == 1])[:n_beside])
        rows = (whole.view == 0) | ((whole.view == 1) & beside)
        points, index = np.unique(whole.point[rows], return_inverse=True)
        part = replace(
            whole,
            points=whole.points[points],
            frame=whole.frame[rows],
            view=whole.view[rows],
            point=index,
            plane=whole.plane[rows],
        )
        assert np.isfinite(map_uncertainty(part, ryu, 0.5).scale_sigma) == known


def test_crossing_motion_before_mirrors_tells_the_scale(ryu: Optics) -> None:
    rng = np.random.default_rng(19)
    noise = rng.normal(0.0, 0.5, (40000, 2))
    points = in_sight(ryu, PATH, rng, 3000)
    sigma = map_uncertainty(bundle_of(ryu, PATH, points, noise), ryu, 0.5).scale_sigma
    assert 0.0 < sigma < 0.05
    half = map_uncertainty(bundle_of(ryu, PATH, points, 0.5 * noise), ryu, 0.25).scale_sigma
    assert half == pytest.approx(sigma / 2, rel=0.1)


def test_the_told_scale_error_is_honest(ryu: Optics) -> None:
    """Over noisy worlds, the scale of the adjusted path scatters as `scale_sigma` says."""
    shares = []
    for seed in range(20):
        rng = np.random.default_rng([20, seed])
        noisy = bundle_of(ryu, PATH, in_sight(ryu, PATH, rng, 700), rng.normal(0.0, 0.4, (20000, 2)))
        poses, points, _ = adjust(noisy, ryu, 1.0, 40, 1e-8)
        sigma = map_uncertainty(replace(noisy, T_world_rig=poses, points=points), ryu, 0.5).scale_sigma
        length, true = (np.linalg.norm(np.diff(T[:, :3, 3], axis=0), axis=1).sum() for T in (poses, PATH))
        shares.append((length / true - 1.0) / sigma)
    assert np.mean(np.abs(shares) < 3.0) >= 0.9
    assert 0.3 < np.sqrt(np.mean(np.square(shares))) < 2.0
