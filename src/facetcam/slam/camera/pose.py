"""Pose of the rig from points seen in any of its views."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from facetcam import _core
from facetcam.geometry import se3
from facetcam.slam.camera.optics import Optics
from facetcam.slam.camera.sight import Sights, across, coordinates, linearise, linearise_whole

Array = NDArray[np.float64]

_STEPS = 15
_DIGITS = 6  # a thousandth of a pixel
_LEVERAGE = 0.3  # of the six numbers of a pose that one point may hold
_NEAR = 3.0  # px within which a point has a part in them
_LEAST_OTHERS, _SHARE_OTHERS = 15, 0.8  # points of a view that must be left, and of all it has
_LEAST_ERROR = 0.2  # px of patches, whatever the others of a frame say
_BORNE_OUT = 25.0  # squared standard deviations


@dataclass(frozen=True, slots=True)
class Pose:
    """A pose with its covariance (6, 6) and the residuals (N,) in pixels; inf behind a view.

    Residuals count along edges, too: points that may lie anywhere there would bear out wrong poses.
    """

    T_world_rig: Array
    covariance: Array
    residuals: Array


def generalized_pose(
    points: Array, views: NDArray[np.int8], plane: Array, optics: Optics, threshold: float
) -> tuple[Array | None, NDArray[np.bool_]]:
    """Pose from matches with outliers: PoseLib's RANSAC for a generalised camera.

    Parameters
    ----------
    points : (N, 3) array
        World points.
    views, plane : (N,), (N, 2) arrays
        Where they are seen.
    threshold : float
        Pixels.

    Returns
    -------
    T_world_rig : (4, 4) array or None
    inliers : (N,) bool array
    """
    import poselib

    inliers = np.zeros(len(points), dtype=bool)
    used = np.unique(views)
    if len(points) < 4:
        return None, inliers
    rows = [np.flatnonzero(views == v) for v in used]
    camera = pinhole(optics)
    pose, info = poselib.estimate_generalized_absolute_pose(
        [plane[r] for r in rows],
        [points[r] for r in rows],
        [camera_pose(optics.T_view_rig[v]) for v in used],
        [camera] * len(used),
        {"max_reproj_error": threshold, "min_iterations": 50, "max_iterations": 2000, "seed": 0},
        {"loss_type": "CAUCHY", "loss_scale": 1.0, "max_iterations": 25},
    )
    for r, flags in zip(rows, info["inliers"]):
        inliers[r] = flags
    if inliers.sum() < 4:
        return None, inliers
    return _steady(se3.inverse(se3.from_rotation_translation(pose.R, pose.t))), inliers


def _steady(T: Array) -> Array:
    """A pose rounded, as a first guess may be, to what PoseLib gives in nearly every call.

    Its digits change with the place of the points in memory, from the eighth on where little holds a pose,
    and with them would change all that follows.
    """
    turn = Rotation.from_quat(np.round(se3.to_quaternion_xyzw(T), _DIGITS))
    return se3.from_rotation_translation(turn.as_matrix(), np.round(T[:3, 3], _DIGITS))


def pinhole(optics: Optics) -> dict[str, object]:
    """PoseLib's description of the ideal pinhole of a view."""
    return {"model": "SIMPLE_PINHOLE", "width": 1, "height": 1, "params": [optics.focal, 0.0, 0.0]}


def camera_pose(T_view_rig: Array) -> Any:
    """PoseLib's description of where a view is on the rig."""
    import poselib

    pose = poselib.CameraPose()
    pose.R = se3.assert_proper_rotation(T_view_rig[:3, :3], "view for pose estimation")
    pose.t = T_view_rig[:3, 3]
    return pose


def refine_pose(
    T_world_rig: Array, seen: Sights, optics: Optics, sigma: float, settled: bool = False
) -> Pose:
    """Iteratively reweighted Gauss-Newton on all views, with a Cauchy kernel of `sigma` pixels.

    The kernel starts wide and narrows, so that a poor first pose is pulled in by all measurements. No kernel
    tames a wrong point that holds a direction of the pose by itself, as a near one before a far wall does:
    the pose follows until it fits. Such points count only where they agree with what the others say. In a map
    whose scale is `settled` so do the few points of a view that tell it otherwise.
    """
    T = _least_squares(T_world_rig, seen, optics, sigma)
    residual, J = linearise(T, seen, optics)
    judges = np.zeros_like(seen.views) if settled else seen.views  # all points, or those of the same view
    alone = _alone(residual, J, judges, optics)
    if alone.any():
        T_others = _least_squares(T, seen.take(~alone), optics, sigma)
        counts = ~alone | _borne_out(*linearise(T_others, seen, optics), ~alone, seen, sigma)
        if not counts.all():
            T = _least_squares(T_others, seen.take(counts), optics, sigma)
    return judged_pose(T, seen, optics, sigma)


def judged_pose(T_world_rig: Array, seen: Sights, optics: Optics, sigma: float) -> Pose:
    """A pose as it is, with what points that are seen from it say of it."""
    whole, J = linearise_whole(T_world_rig, seen, optics)
    behind = ~J.any(axis=(1, 2))
    told = across(seen.edge, whole), across(seen.edge, J), np.ones(len(whole), np.bool_)
    found = _Weighted.of(*told, coordinates(seen.edge), sigma)
    size = np.where(behind, np.inf, np.linalg.norm(whole, axis=1))
    return Pose(T_world_rig, found.variance * found.inverse, size)


def _least_squares(T_world_rig: Array, seen: Sights, optics: Optics, sigma: float) -> Array:
    (T,) = _core.refine_pose(
        focal=optics.focal,
        T_view_rig=np.ascontiguousarray(optics.T_view_rig),
        T_world_rig=np.ascontiguousarray(T_world_rig)[None],
        points=np.ascontiguousarray(seen.points),
        view=seen.views.astype(np.int64),
        plane=np.ascontiguousarray(seen.plane),
        edge=np.ascontiguousarray(seen.edge),
        sigma=sigma,
        max_steps=_STEPS,
    )
    return np.asarray(T)


@dataclass(frozen=True, slots=True)
class _Weighted:
    """A pose as robust measurements see it: the variance of one, and the inverse (6, 6) of their information
    in units of it.
    """

    variance: float
    inverse: Array

    @classmethod
    def of(
        cls, residual: Array, J: Array, counts: NDArray[np.bool_], coordinates: Array, sigma: float
    ) -> Self:
        """From what counts of residuals (N, 2) and of derivatives (N, 2, 6) in so many `coordinates` (N,).

        Only sights that `counts` names are heard.
        """
        size = np.linalg.norm(residual, axis=1)
        weight = counts / (1.0 + (size / sigma) ** 2)
        variance = max(float(np.sum(weight * size**2) / max(float(weight @ coordinates) - 6.0, 1.0)), 1e-4)
        return cls(variance, _inverse_information(J, weight))


def _alone(residual: Array, J: Array, judges: NDArray[np.integer], optics: Optics) -> NDArray[np.bool_]:
    """Points that hold a good part of the pose by themselves, unlike most others with the same `judges` (N,).

    The few points of another view that tell the scale of a map hold a part of it, too, and must be heard.
    """
    inverse = _inverse_information(J, np.linalg.norm(residual, axis=1) < _NEAR)
    alone = np.einsum("nij,nij->n", J @ inverse, J) > _LEVERAGE
    others, everyone = (np.bincount(v, minlength=optics.n_views) for v in (judges[~alone], judges))
    judged = others >= np.maximum(_LEAST_OTHERS, _SHARE_OTHERS * everyone)
    return np.asarray(alone & judged[judges])


def _borne_out(
    residual: Array, J: Array, others: NDArray[np.bool_], seen: Sights, sigma: float
) -> NDArray[np.bool_]:
    """Points within what the pose from the `others` foretells of them (deleted residuals)."""
    told = _Weighted.of(residual, J, others, coordinates(seen.edge), sigma)
    variance = max(told.variance, _LEAST_ERROR**2)
    S = variance * (np.eye(2) + J @ told.inverse @ np.swapaxes(J, 1, 2))
    squared = np.einsum("ni,ni->n", residual, np.linalg.solve(S, residual[..., None])[..., 0])
    return np.asarray(squared < _BORNE_OUT)


def _inverse_information(J: Array, weight: Array | NDArray[np.bool_]) -> Array:
    """Inverse (6, 6) of what residuals with derivatives (N, 2, 6) and weights (N,) say of a pose."""
    weighted = (J * weight[:, None, None]).reshape(-1, 6)
    return np.asarray(np.linalg.pinv(weighted.T @ J.reshape(-1, 6), hermitian=True))
