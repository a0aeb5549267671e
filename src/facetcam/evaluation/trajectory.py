"""Errors of an estimated trajectory against the truth: one pure function a metric.

Times are (N,) seconds, positions (N, 3) metres, poses (N, 4, 4) T_world_body. Metrics take matched arrays;
`associate` matches two trajectories by time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from facetcam.errors import FacetcamError
from facetcam.geometry import se3

Array = NDArray[np.float64]
Trajectory = tuple[Array, Array]  # times, poses

STANDING = 1e-9  # metres; a path that spreads less has no direction and no scale to align


@dataclass(frozen=True, slots=True)
class Alignment:
    """The similarity that maps points p of one frame to scale * R p + t of another."""

    scale: float
    R: Array
    t: Array

    def apply(self, points: Array) -> Array:
        """Map points (N, 3)."""
        return self.scale * points @ self.R.T + self.t


@dataclass(frozen=True, slots=True)
class Errors:
    """Summary of errors of one kind, in their unit."""

    rmse: float
    median: float
    mean: float
    max: float

    @classmethod
    def of(cls, values: Array) -> Errors:
        """Summarise (N,) errors, N > 0."""
        return cls(
            rmse=float(np.sqrt(np.mean(values**2))),
            median=float(np.median(values)),
            mean=float(np.mean(values)),
            max=float(np.max(values)),
        )


@dataclass(frozen=True, slots=True)
class TrajectoryErrors:
    """Everything that `facetcam evaluate trajectory` tells; metres and radians."""

    matched: int
    estimated: int
    true_length: float
    ate: Errors  # after rigid alignment
    ate_scaled: Errors  # after alignment with scale
    scale_error: float  # estimate / truth - 1; 0.01: one per cent too large
    rpe_translation: Errors
    rpe_rotation: Errors


def evaluate(
    estimate: Trajectory, truth: Trajectory, max_gap: float = 0.02, step: int = 1
) -> TrajectoryErrors:
    """All errors of an estimate at once.

    Parameters
    ----------
    estimate, truth : (times, poses)
    max_gap : float
        Largest time in seconds between two poses that are compared.
    step : int
        Number of poses between which relative errors are taken.

    Raises
    ------
    FacetcamError
        If fewer than three poses, or no more than `step`, can be matched.
    """
    own, true = associate(estimate[0], truth[0], max_gap)
    if len(own) < max(3, step + 1):
        raise FacetcamError(
            f"only {len(own)} of {len(estimate[0])} estimated poses have a true one within {max_gap:g} s;"
            " are both on one clock?"
        )
    est, gt = estimate[1][own], truth[1][true]
    translation, rotation = relative_errors(est, gt, step)
    return TrajectoryErrors(
        matched=len(own),
        estimated=len(estimate[0]),
        true_length=path_length(gt[:, :3, 3]),
        ate=ate(est[:, :3, 3], gt[:, :3, 3], with_scale=False),
        ate_scaled=ate(est[:, :3, 3], gt[:, :3, 3], with_scale=True),
        scale_error=scale_error(est[:, :3, 3], gt[:, :3, 3]),
        rpe_translation=Errors.of(translation),
        rpe_rotation=Errors.of(rotation),
    )


def associate(times: Array, others: Array, max_gap: float) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Match each time to the nearest other one, each used once at most.

    Parameters
    ----------
    times, others : (N,), (M,) arrays
        Increasing.
    max_gap : float
        Largest difference in seconds.

    Returns
    -------
    indices into `times` and into `others`, both increasing
    """
    nearest = np.searchsorted((others[1:] + others[:-1]) / 2, times)
    gaps = np.abs(others[nearest] - times)
    order = np.lexsort((gaps, nearest))
    best = order[np.unique(nearest[order], return_index=True)[1]]  # of several for one, the closest
    own = np.sort(best[gaps[best] <= max_gap])
    return own, nearest[own]


def align(source: Array, target: Array, with_scale: bool) -> Alignment:
    """Least-squares motion of points onto points.

    Parameters
    ----------
    source, target : (N, 3) arrays
    with_scale : bool
        Whether the scale is free; points that do not move keep scale 1.

    Notes
    -----
    S. Umeyama, Least-squares estimation of transformation parameters between two point patterns, PAMI 1991.
    """
    source_mean, target_mean = source.mean(axis=0), target.mean(axis=0)
    p, q = source - source_mean, target - target_mean
    U, singular, Vt = np.linalg.svd(q.T @ p / len(p))
    handed = np.array([1.0, 1.0, np.sign(np.linalg.det(U) * np.linalg.det(Vt))])
    R = (U * handed) @ Vt
    moving = min(np.std(p, axis=0).max(), np.std(q, axis=0).max()) > STANDING
    scale = float(singular @ handed / np.mean(np.sum(p**2, axis=1))) if with_scale and moving else 1.0
    return Alignment(scale, R, target_mean - scale * R @ source_mean)


def ate(estimate: Array, truth: Array, with_scale: bool) -> Errors:
    """Absolute trajectory error: distances of matched positions (N, 3) after alignment, in metres."""
    return Errors.of(position_errors(estimate, truth, with_scale))


def position_errors(estimate: Array, truth: Array, with_scale: bool) -> Array:
    """Distances (N,) of matched positions after alignment of the estimate onto the truth, in metres."""
    aligned = align(estimate, truth, with_scale).apply(estimate)
    return np.asarray(np.linalg.norm(aligned - truth, axis=1))


def scale_error(estimate: Array, truth: Array) -> float:
    """By how much the estimate is too large: 0.01 is one per cent; 0 for a path that stands still."""
    scale = align(estimate, truth, with_scale=True).scale
    return 1.0 / scale - 1.0 if scale > 0 else 0.0


def relative_errors(estimate: Array, truth: Array, step: int) -> tuple[Array, Array]:
    """Relative pose errors over `step` poses: translation (N - step,) metres, rotation (N - step,) radians.

    Notes
    -----
    J. Sturm et al., A benchmark for the evaluation of RGB-D SLAM systems, IROS 2012, equation 1.
    """
    moved = se3.inverse(estimate[:-step]) @ estimate[step:]
    truly = se3.inverse(truth[:-step]) @ truth[step:]
    error = se3.inverse(truly) @ moved
    cosine = (np.trace(error[:, :3, :3], axis1=1, axis2=2) - 1.0) / 2.0
    sine = np.linalg.norm(error[:, :3, :3] - np.swapaxes(error[:, :3, :3], 1, 2), axis=(1, 2)) / np.sqrt(8.0)
    return np.linalg.norm(error[:, :3, 3], axis=1), np.arctan2(sine, cosine)


def path_length(positions: Array) -> float:
    """Length in metres of the way through positions (N, 3)."""
    return float(np.linalg.norm(np.diff(positions, axis=0), axis=1).sum())
