"""Pose of the rig from points seen in any of its views."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from facetcam import _core
from facetcam.geometry import se3
from facetcam.slam.optics import Optics

Array = NDArray[np.float64]

_STEPS = 15
_MIN_DEPTH = 0.01  # metres


@dataclass(frozen=True, slots=True)
class Pose:
    """A pose with its covariance (6, 6) and the residuals (N,) in pixels; inf behind a view."""

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
    # PoseLib's last digits change from call to call, and with them all that follows.
    return np.round(se3.inverse(se3.from_rotation_translation(pose.R, pose.t)), 9), inliers


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
    T_world_rig: Array, points: Array, views: NDArray[np.int8], plane: Array, optics: Optics, sigma: float
) -> Pose:
    """Iteratively reweighted Gauss-Newton on all views, with a Cauchy kernel of `sigma` pixels.

    The kernel starts wide and narrows, so that a poor first pose is pulled in by all measurements.
    """
    (T,) = _core.refine_pose(
        focal=optics.focal,
        T_view_rig=np.ascontiguousarray(optics.T_view_rig),
        T_world_rig=np.ascontiguousarray(T_world_rig)[None],
        points=np.ascontiguousarray(points),
        view=views.astype(np.int64),
        plane=np.ascontiguousarray(plane),
        sigma=sigma,
        max_steps=_STEPS,
    )
    residual, J = linearise(T, points, views, plane, optics)
    size = np.linalg.norm(residual, axis=1)
    weight = 1.0 / (1.0 + (size / sigma) ** 2)
    variance = max(float(np.sum(weight * size**2) / max(2.0 * weight.sum() - 6.0, 1.0)), 1e-4)
    H = np.einsum("n,nij,nik->jk", weight, J, J)
    covariance = variance * np.linalg.pinv(H, hermitian=True)
    behind = optics.to_plane(se3.transform(se3.inverse(T), points), views)[1] < _MIN_DEPTH
    return Pose(T, covariance, np.where(behind, np.inf, size))


def linearise(
    T_world_rig: Array, points: Array, views: NDArray[np.integer], plane: Array, optics: Optics
) -> tuple[Array, Array]:
    """Residuals (N, 2) of points on their pinholes, and derivative (N, 2, 6) by a right-hand twist."""
    residual, by_rig, points_rig = linearise_sight(T_world_rig, points, views, plane, optics)
    x, y, z = points_rig.T[:, :, None]
    a, b, c = np.moveaxis(by_rig, 2, 0)  # the point moves against the rig: by_rig [p]x, then -by_rig
    return residual, np.stack([b * z - c * y, c * x - a * z, a * y - b * x, -a, -b, -c], axis=2)


def linearise_sight(
    T_world_rig: Array, points: Array, views: NDArray[np.integer], plane: Array, optics: Optics
) -> tuple[Array, Array, Array]:
    """Residuals (N, 2) of points on their pinholes, derivatives (N, 2, 3) by points in the rig, and these."""
    points_rig = se3.transform(se3.inverse(T_world_rig), points)
    predicted, depth = optics.to_plane(points_rig, views)
    in_front = depth > _MIN_DEPTH
    depth = np.where(in_front, depth, 1.0)[:, None]
    across, along = optics.T_view_rig[views, :2, :3], optics.T_view_rig[views, 2, :3]
    by_rig = optics.focal / depth[:, :, None] * across - (predicted / depth)[:, :, None] * along[:, None, :]
    by_rig[~in_front] = 0.0
    return np.where(in_front[:, None], predicted - plane, 0.0), by_rig, points_rig
