"""Errors of trajectories against evo, and against motions whose errors are known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from facetcam.errors import FacetcamError
from facetcam.evaluation import trajectory as evaluation
from facetcam.geometry import se3

evo_trajectory = pytest.importorskip("evo.core.trajectory")
evo_metrics = pytest.importorskip("evo.core.metrics")
evo_sync = pytest.importorskip("evo.core.sync")

DEGREE = np.pi / 180


def walk(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A smooth random walk: times, poses."""
    rng = np.random.default_rng(seed)
    poses = [np.eye(4)]
    for _ in range(count - 1):
        step = np.concatenate([rng.normal(0, 0.05, 3), rng.normal([0.1, 0, 0], 0.05)])
        poses.append(poses[-1] @ se3.exp(step))
    return np.arange(count) / 10.0, np.array(poses)


def disturbed(poses: np.ndarray, seed: int, scale: float = 1.0) -> np.ndarray:
    """Poses in another world and scale, with noise."""
    rng = np.random.default_rng(seed)
    T = se3.exp([0.3, -1.0, 0.5, 4.0, -2.0, 1.0])
    out = np.array([T @ pose @ se3.exp(rng.normal(0, 0.02, 6)) for pose in poses])
    out[:, :3, 3] *= scale
    return out


def to_evo(times: np.ndarray, poses: np.ndarray) -> object:
    return evo_trajectory.PoseTrajectory3D(poses_se3=list(poses), timestamps=times)


@pytest.mark.parametrize("with_scale", [False, True])
@pytest.mark.parametrize("scale", [1.0, 0.4])
@pytest.mark.parametrize("seed", [1, 2])
def test_ate_is_that_of_evo(seed: int, scale: float, with_scale: bool) -> None:
    times, truth = walk(80, seed)
    estimate = disturbed(truth, seed + 10, scale)
    reference, other = to_evo(times, truth), to_evo(times, estimate)
    other.align(reference, correct_scale=with_scale)
    metric = evo_metrics.APE(evo_metrics.PoseRelation.translation_part)
    metric.process_data((reference, other))
    expected = metric.get_all_statistics()
    got = evaluation.ate(estimate[:, :3, 3], truth[:, :3, 3], with_scale)
    for name in ("rmse", "median", "mean", "max"):
        assert getattr(got, name) == pytest.approx(expected[name], rel=1e-9)


@pytest.mark.parametrize("step", [1, 7])
def test_rpe_is_that_of_evo(step: int) -> None:
    times, truth = walk(60, 3)
    estimate = disturbed(truth, 4)
    translation, rotation = evaluation.relative_errors(estimate, truth, step)
    for values, relation in (
        (translation, evo_metrics.PoseRelation.translation_part),
        (rotation, evo_metrics.PoseRelation.rotation_angle_rad),
    ):
        metric = evo_metrics.RPE(relation, delta=step, delta_unit=evo_metrics.Unit.frames, all_pairs=True)
        metric.process_data((to_evo(times, truth), to_evo(times, estimate)))
        np.testing.assert_allclose(values, metric.error, atol=1e-9)


def test_association_is_that_of_evo() -> None:
    rng = np.random.default_rng(5)
    times, _ = walk(50, 6)
    own = (times + rng.uniform(-0.03, 0.03, 50))[rng.random(50) < 0.6]
    mine = evaluation.associate(own, times, 0.02)
    expected = evo_sync.matching_time_indices(own, times, 0.02)
    assert [list(mine[0]), list(mine[1])] == [list(expected[0]), list(expected[1])]
    assert len(mine[0]) > 10


def test_association_uses_each_true_pose_once_and_no_far_one() -> None:
    own, true = evaluation.associate(np.array([0.0, 0.99, 1.0, 1.3, 9.0]), np.array([1.0, 1.31, 2.0]), 0.05)
    assert own.tolist() == [2, 3]
    assert true.tolist() == [0, 1]
    own, true = evaluation.associate(np.array([0.0, 1.0]), np.array([1.0]), 0.05)
    assert (own.tolist(), true.tolist()) == ([1], [0])


def test_a_moved_turned_and_scaled_copy_has_no_error_and_its_scale_is_found() -> None:
    times, truth = walk(40, 7)
    estimate = truth.copy()
    R = Rotation.from_rotvec([0.2, 1.4, -0.7]).as_matrix()
    estimate[:, :3, 3] = 1.05 * truth[:, :3, 3] @ R.T + [3, 4, 5]
    errors = evaluation.evaluate((times, estimate), (times, truth))
    assert errors.ate_scaled.max < 1e-12
    assert errors.scale_error == pytest.approx(0.05)
    assert errors.ate.rmse > 0.01
    assert errors.true_length == pytest.approx(
        sum(np.linalg.norm(b - a) for a, b in zip(truth[:-1, :3, 3], truth[1:, :3, 3]))
    )


def test_known_relative_error() -> None:
    """Every step turned by one degree and lengthened by a centimetre too much."""
    step, error = se3.exp([0, 0, 0.1, 0.1, 0, 0]), se3.exp([0, 0, DEGREE, 0, 0, 0])
    error[:3, 3] = [0.01, 0, 0]
    truth, estimate = [np.eye(4)], [np.eye(4)]
    for _ in range(10):
        truth.append(truth[-1] @ step)
        estimate.append(estimate[-1] @ step @ error)
    translation, rotation = evaluation.relative_errors(np.array(estimate), np.array(truth), 1)
    np.testing.assert_allclose(translation, 0.01, atol=1e-12)
    np.testing.assert_allclose(rotation, DEGREE, atol=1e-12)


def test_mirror_images_are_not_aligned_away() -> None:
    points = np.random.default_rng(8).normal(size=(30, 3))
    assert evaluation.ate(points * [1, 1, -1], points, with_scale=True).rmse > 0.3


def test_a_standing_camera_has_finite_errors() -> None:
    times = np.arange(10) / 10
    still = np.tile(np.eye(4), (10, 1, 1))
    _, moving = walk(10, 9)
    for estimate, truth in ((still, still), (still, moving), (moving, still)):
        errors = evaluation.evaluate((times, estimate), (times, truth))
        assert np.isfinite([errors.ate.rmse, errors.ate_scaled.rmse, errors.scale_error]).all()
    errors = evaluation.evaluate((times, moving), (times, still))
    assert errors.ate_scaled.rmse == pytest.approx(errors.ate.rmse)  # scale does not shrink motion to nothing


def test_too_little_in_common() -> None:
    times, poses = walk(10, 10)
    with pytest.raises(FacetcamError, match=r"only 0 of 10 .* one clock"):
        evaluation.evaluate((times + 100, poses), (times, poses))
    with pytest.raises(FacetcamError, match="only 2"):
        evaluation.evaluate((times[:2], poses[:2]), (times, poses))
