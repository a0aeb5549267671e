"""Pose of a keyframe from points of the map, and from corners that have no place in it yet."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from facetcam.geometry import se3
from facetcam.slam.config import SlamConfig
from facetcam.slam.map import Observations
from facetcam.slam.measure import Measurements
from facetcam.slam.optics import Optics
from facetcam.slam.pairs import Pairs
from facetcam.slam.pose import linearise

Array = NDArray[np.float64]

_LOOSENESS = (8.0, 4.0, 2.0, 1.0, 1.0)  # of the losses, step by step
_STEP = 1e-5  # of a twist, for derivatives
_WON, _KEPT, _FEW = 1.1, 0.8, 3  # shares of what agreed with a pose, beyond a few, that must with another
_WITNESSES = 2  # views
_CORNERS = 2.0  # times as much as patches do corners err


def agreed_pose(
    T_world_last: Array,
    T_world_rig: Array,
    seen: Measurements | Observations,
    xyz: Array,
    pairs: Pairs,
    optics: Optics,
    config: SlamConfig,
) -> Array | None:
    """The pose of `joint_pose` if corners of two views or more are won by it, and nothing else is lost.

    One view alone may be full of people, who would draw the pose along. Parameters are those of `joint_pose`.
    """
    data = (seen, xyz, pairs, optics, config)
    T, T_last = joint_pose(T_world_last, T_world_rig, *data), se3.inverse(T_world_last)
    before, after = (_agreeing(pose, T_last, *data) for pose in (T_world_rig, T))
    won = after[:-1] > _WON * before[:-1] + _FEW
    return T if won.sum() >= _WITNESSES and np.all(after >= _KEPT * before - _FEW) else None


def joint_pose(
    T_world_last: Array,
    T_world_rig: Array,
    seen: Measurements | Observations,
    xyz: Array,
    pairs: Pairs,
    optics: Optics,
    config: SlamConfig,
) -> Array:
    """Refine a pose by reprojections of map points and epipolar distances of corners since an earlier one.

    In plain rooms few points hold a pose, and can be wrong together; corners of every view tell how the rig
    has turned and which way it went, before any has a depth. Cauchy losses, which begin wide.

    Parameters
    ----------
    T_world_last, T_world_rig : (4, 4) arrays
        Poses of the earlier keyframe, which is held, and of the new one.
    seen, xyz : Measurements or Observations of N points, (N, 3) array
        Of the new one.
    pairs : Pairs
        Corners of the earlier keyframe and of the new one; those at rest do not count.
    optics : Optics
    config : SlamConfig

    Returns
    -------
    T_world_rig : (4, 4) array
    """
    T_last, pairs = se3.inverse(T_world_last), pairs.take(pairs.move())
    nudges = np.stack([se3.exp(s) for s in np.concatenate([_STEP * np.eye(6), -_STEP * np.eye(6)])])
    for looseness in _LOOSENESS:
        residual, J = linearise(T_world_rig, xyz, seen.view, seen.plane, optics)
        beside = pairs.epipolar_errors(T_last @ T_world_rig, optics)
        ahead, back = np.split(pairs.epipolar_errors(T_last @ T_world_rig @ nudges, optics), 2)
        slope = (ahead - back).T / (2.0 * _STEP)
        points = looseness * config.pixel_sigma
        corners = _CORNERS * points
        w = 1.0 / (points**2 + np.sum(residual**2, axis=1))
        v = 1.0 / (corners**2 + beside**2)
        H = np.einsum("n,nij,nik->jk", w, J, J) + np.einsum("n,nj,nk->jk", v, slope, slope)
        g = np.einsum("n,nij,ni->j", w, J, residual) + slope.T @ (v * beside)
        T_world_rig = T_world_rig @ se3.exp(-np.linalg.solve(H + 1e-9 * np.trace(H) * np.eye(6), g))
    return np.asarray(T_world_rig)


def _agreeing(
    T_world_rig: Array,
    T_last: Array,
    seen: Measurements | Observations,
    xyz: Array,
    pairs: Pairs,
    optics: Optics,
    config: SlamConfig,
) -> Array:
    """How many points fit a pose, and how many corners of each view."""
    residual, _ = linearise(T_world_rig, xyz, seen.view, seen.plane, optics)
    points = np.count_nonzero(np.linalg.norm(residual, axis=1) < config.gate)
    fits = pairs.views[pairs.fit(T_last @ T_world_rig, optics)]
    return np.append(np.bincount(fits, minlength=optics.n_views), points)
