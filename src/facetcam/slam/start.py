"""The first map: two frames far enough apart, their motion from odometry or from the images alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from facetcam.features import match_windowed
from facetcam.geometry import se3
from facetcam.geometry.triangulation import triangulate_two_rays
from facetcam.slam.config import SlamConfig
from facetcam.slam.epipolar import epipolar_error, match_along_epipolars
from facetcam.slam.frame import Corners
from facetcam.slam.optics import Optics

Array = NDArray[np.float64]
Index = NDArray[np.int64]

MIN_MATCHES = 60
_SEARCH = 0.3  # of the frame's width
_START_PARALLAX = 0.015  # radians
_UNKNOWN_DEPTH = 2.0  # metres: the median depth of a scene whose scale the images cannot tell
_SCALES = np.geomspace(0.25, 4.0, 33)
_EPIPOLAR_GATE = 2.0  # px
START_GATE = 8.0  # px: odometry and the first guess of the scale are rough


def match_corners(a: Corners, b: Corners, config: SlamConfig) -> tuple[Index, Index]:
    """Corners of two frames that look alike, in the same view and not far from each other on it."""
    hits = match_windowed(
        a.descriptors,
        a.pixels,
        a.views,
        b.descriptors,
        b.pixels,
        b.views,
        radius=_SEARCH * float(np.ptp(a.pixels[:, 0])) if len(a) else 0.0,
        max_distance=config.match_distance,
        ratio=config.match_ratio,
    )
    rows = np.flatnonzero(hits >= 0)
    return rows, hits[rows].astype(np.int64)


def parallax(a: Corners, rows_a: Index, b: Corners, rows_b: Index, T_a_b: Array, optics: Optics) -> tuple[Array, Array]:
    """Distances (N,) along the rays of `a` and angles (N,) between matched rays, for a given motion."""
    origins_a = optics.origins(a.views[rows_a])
    rays_a = optics.rays(a.pixels[rows_a], a.views[rows_a])
    origins_b = se3.transform(T_a_b, optics.origins(b.views[rows_b]))
    rays_b = optics.rays(b.pixels[rows_b], b.views[rows_b]) @ T_a_b[:3, :3].T
    _, distance, other, angle = triangulate_two_rays(origins_a, rays_a, origins_b, rays_b)
    return np.where(other > 0, distance, -1.0), angle


def _epipolar(a: Corners, rows_a: Index, b: Corners, rows_b: Index, T_a_b: Array, optics: Optics) -> Array:
    """Sampson distances (N,) in pixels of matched corners."""
    error = np.empty(len(rows_a))
    views = a.views[rows_a]
    for view in np.unique(views):
        rows = views == view
        plane_a = optics.plane(a.pixels[rows_a[rows]], views[rows])
        plane_b = optics.plane(b.pixels[rows_b[rows]], views[rows])
        error[rows] = epipolar_error(plane_a, plane_b, int(view), T_a_b, optics)
    return error


def enough_parallax(a: Corners, b: Corners, T_a_b: Array, optics: Optics, config: SlamConfig) -> bool:
    """Tell whether two frames with a known motion can start a map."""
    everything = np.arange(len(a)), np.arange(len(b))
    rows_a, rows_b = match_along_epipolars(
        a, everything[0], b, everything[1], T_a_b, START_GATE, optics, config
    )
    return _count_good(a, rows_a, b, rows_b, T_a_b, optics, START_GATE) >= MIN_MATCHES


def estimate_motion(a: Corners, b: Corners, optics: Optics, config: SlamConfig) -> Array | None:
    """Motion `T_a_b` between two frames from their corners alone, or None where they cannot tell.

    The view with the most matches gives rotation and direction (PoseLib, five points); the length is the
    one with which all views agree best, and `_UNKNOWN_DEPTH` where they do not care.
    """
    rows_a, rows_b = match_corners(a, b, config)
    if len(rows_a) < MIN_MATCHES:
        return None
    best: tuple[int, int, Array] | None = None
    for view in np.unique(a.views[rows_a]):
        rows = a.views[rows_a] == view
        candidate = _view_motion(a, rows_a[rows], b, rows_b[rows], int(view), optics)
        if candidate is not None and (best is None or candidate[0] > best[0]):
            best = candidate
    if best is None:
        return None
    T_a_b = _with_length(best[1], best[2], a, rows_a, b, rows_b, optics)
    fits = _epipolar(a, rows_a, b, rows_b, T_a_b, optics) < _EPIPOLAR_GATE
    good = _count_good(a, rows_a, b, rows_b, T_a_b, optics, _EPIPOLAR_GATE)
    return T_a_b if good >= MIN_MATCHES and fits.mean() > 0.6 else None


def _count_good(
    a: Corners, rows_a: Index, b: Corners, rows_b: Index, T_a_b: Array, optics: Optics, gate: float
) -> int:
    """Matches that fit a motion, lie in front of the views and have parallax."""
    fits = _epipolar(a, rows_a, b, rows_b, T_a_b, optics) < gate
    distance, angle = parallax(a, rows_a, b, rows_b, T_a_b, optics)
    return int(np.sum(fits & (distance > 0) & (angle > _START_PARALLAX)))


def _view_motion(
    a: Corners, rows_a: Index, b: Corners, rows_b: Index, view: int, optics: Optics
) -> tuple[int, int, Array] | None:
    """Inlier count, view, and motion of the view's pinhole with a translation of length one."""
    import poselib

    if len(rows_a) < MIN_MATCHES // 3:
        return None
    views = np.full(len(rows_a), view)
    camera = {"model": "SIMPLE_PINHOLE", "width": 1, "height": 1, "params": [optics.focal, 0.0, 0.0]}
    pose, info = poselib.estimate_relative_pose(
        optics.plane(a.pixels[rows_a], views),
        optics.plane(b.pixels[rows_b], views),
        camera,
        camera,
        {"max_epipolar_error": 1.0, "min_iterations": 200, "max_iterations": 3000, "seed": 0},
        {},
    )
    length = float(np.linalg.norm(pose.t))
    if length < 1e-9:
        return None
    T_b_a = se3.from_rotation_translation(pose.R, pose.t / length)
    return int(np.sum(info["inliers"])), view, se3.inverse(T_b_a)


def _with_length(
    view: int, T_view: Array, a: Corners, rows_a: Index, b: Corners, rows_b: Index, optics: Optics
) -> Array:
    """Choose the length of a motion whose direction is known in one view."""

    def rig_motion(length: float) -> Array:
        T = T_view.copy()
        T[:3, 3] *= length
        return optics.T_rig_view[view] @ T @ optics.T_view_rig[view]

    distance, _ = parallax(a, rows_a, b, rows_b, rig_motion(1.0), optics)
    ahead = distance[(distance > 0) & (distance < 1e3)]
    usual = _UNKNOWN_DEPTH / max(float(np.median(ahead)), 1e-6) if len(ahead) else 1.0
    best, best_cost = rig_motion(usual), np.inf
    for factor in sorted(_SCALES, key=lambda s: abs(float(np.log(s)))):
        T = rig_motion(usual * factor)
        error = _epipolar(a, rows_a, b, rows_b, T, optics)
        cost = float(np.minimum(error, _EPIPOLAR_GATE).mean())
        if cost < 0.98 * best_cost:  # a flat cost keeps the usual length
            best, best_cost = T, cost
    return best
