"""Motions between two frames that are worth a try: of each view by itself, and of all as one camera."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from facetcam.geometry import se3
from facetcam.slam.camera.optics import Optics
from facetcam.slam.camera.pose import camera_pose, pinhole
from facetcam.slam.relative_pose.pairs import Pairs
from facetcam.slam.relative_pose.witnesses import MIN_VIEW_MATCHES, shares

Array = NDArray[np.float64]

_UNKNOWN_DEPTH = 3.0  # metres: the median depth of a scene whose scale the images cannot tell
_LENGTHS = np.geomspace(0.25, 4.0, 17)
_RANSAC = {"max_epipolar_error": 1.0, "min_iterations": 200, "max_iterations": 2000, "seed": 0}


def joint_proposal(pairs: Pairs, proposals: dict[int, Array], optics: Optics) -> Array | None:
    """Of the motions that single views propose, and all of them as one camera, the one that explains most of
    what each view shows.
    """
    ways = [_by_length(T, optics.T_rig_view[v], optics.T_view_rig[v]) for v, T in proposals.items()]
    whole = rig_motion(pairs, optics)
    ways += [] if whole is None else [_by_length(whole, np.eye(4), np.eye(4))]
    if not ways:
        return None
    motions = np.stack([_with_length(way, pairs, optics) for way in ways])
    share = shares(pairs.views, pairs.fit(motions, optics))[1].sum(axis=-1)
    return np.asarray(motions[int(np.argmax(share))])


def view_motions(pairs: Pairs, optics: Optics) -> dict[int, Array]:
    """Motion of each view's pinhole by itself, of unit length, for the views with enough pairs."""
    motions = {int(v): _view_motion(pairs, int(v), optics) for v in np.unique(pairs.views)}
    return {v: T for v, T in motions.items() if T is not None}


def _view_motion(pairs: Pairs, view: int, optics: Optics) -> Array | None:
    """Motion of one view's pinhole with a translation of length one."""
    import poselib

    rows = pairs.views == view
    if rows.sum() < MIN_VIEW_MATCHES:
        return None
    camera = pinhole(optics)
    pose, _ = poselib.estimate_relative_pose(
        pairs.plane_a[rows], pairs.plane_b[rows], camera, camera, _RANSAC, {}
    )
    return _unit_motion(pose)


def rig_motion(pairs: Pairs, optics: Optics) -> Array | None:
    """Motion of all views together, as one generalised camera, with a translation of length one.

    Few pairs in each view are many together. Its length is determined too poorly to be taken over.
    """
    import poselib

    if len(np.unique(pairs.views)) < 2:
        return None
    extrinsics, matches = [], []
    for view, T in enumerate(optics.T_view_rig):
        match, rows = poselib.PairwiseMatches(), pairs.views == view
        match.cam_id1 = match.cam_id2 = view
        match.x1, match.x2 = pairs.plane_a[rows], pairs.plane_b[rows]
        extrinsics.append(camera_pose(T))
        matches.append(match)
    cameras = optics.n_views * [pinhole(optics)]
    pose, _ = poselib.estimate_generalized_relative_pose(
        matches, extrinsics, cameras, extrinsics, cameras, _RANSAC, {}
    )
    return _unit_motion(pose)


def _unit_motion(pose: Any) -> Array | None:
    """Motion `T_a_b` of length one from PoseLib's pose; None where it is a turn alone."""
    length = float(np.linalg.norm(pose.t))
    if not length > 1e-9:
        return None
    # PoseLib's last digits change from call to call, and with them all that follows.
    T = np.round(se3.inverse(se3.from_rotation_translation(pose.R, pose.t / length)), 9)
    return T if np.all(np.isfinite(T)) else None


def _by_length(T_unit: Array, T_rig_view: Array, T_view_rig: Array) -> Callable[[float], Array]:
    """Motion of the rig as a function of the length of that of one view, or of its own."""

    def motion(length: float) -> Array:
        T = T_unit.copy()
        T[:3, 3] *= length
        return np.asarray(T_rig_view @ T @ T_view_rig)

    return motion


def _with_length(rig_motion: Callable[[float], Array], pairs: Pairs, optics: Optics) -> Array:
    """Motion of the rig with the length that suits all views."""
    distance, _ = pairs.parallax(rig_motion(1.0), optics)
    ahead = distance[(distance > 0) & (distance < 1e3)]
    usual = _UNKNOWN_DEPTH / max(float(np.median(ahead)), 1e-6) if len(ahead) else 1.0
    best, best_cost = rig_motion(usual), np.inf
    usual_first = _LENGTHS[np.argsort(np.abs(np.log(_LENGTHS)), kind="stable")]
    motions = np.stack([rig_motion(usual * float(factor)) for factor in usual_first])
    for T, cost in zip(motions, pairs.misfit(motions, optics)):
        if cost < 0.98 * best_cost:  # a flat cost keeps the usual length
            best, best_cost = T, cost
    return best
