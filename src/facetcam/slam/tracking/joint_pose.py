"""Pose of a keyframe from points of the map, and from corners that have no place in it yet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from facetcam.geometry import se3
from facetcam.slam.camera.optics import Optics
from facetcam.slam.camera.sight import Sights, linearise, linearise_sight
from facetcam.slam.config import SlamConfig
from facetcam.slam.relative_pose.pairs import Pairs

Array = NDArray[np.float64]

_LOOSENESS = (8.0, 4.0, 2.0, 1.0, 1.0)  # of the losses, step by step
_STEP = 1e-5  # of a twist, for derivatives
_WON, _KEPT, _FEW = 1.1, 0.8, 3  # shares of what agreed with a pose, beyond a few, that must with another
_WITNESSES = 2  # views
_LEAST_POINTS, _SHARE_POINTS = 6, 0.4  # points that hold the length of a way, and of those found
_SHARE_CORNERS = 0.7
_CORNERS = 2.0  # times as much as patches do corners err
_NUDGES = np.stack([se3.exp(s) for s in np.concatenate([_STEP * np.eye(6), -_STEP * np.eye(6)])])


@dataclass(frozen=True, slots=True)
class JointSight:
    """What a frame saw of the map, and of the corners of an earlier keyframe.

    In plain rooms few points hold a pose, and can be wrong together; corners of every view tell how the rig
    has turned and which way it went, before any has a depth.

    Attributes
    ----------
    T_world_last : (4, 4) array
        Pose of the earlier keyframe, which is held.
    seen : Sights
        Of points of the map, in the frame.
    pairs : Pairs
        Corners of the earlier keyframe and of the frame.
    optics : Optics
    config : SlamConfig
    """

    T_world_last: Array
    seen: Sights
    pairs: Pairs
    optics: Optics
    config: SlamConfig

    def agreed_pose(self, T_world_rig: Array) -> Array | None:
        """The pose refined, if corners of two views or more are won by it, and nothing else is lost.

        One view alone may be full of people, who would draw the pose along.
        """
        T = self.refined_pose(T_world_rig)
        before, after = self._agreeing(T_world_rig), self._agreeing(T)
        won = after[:-1] > _WON * before[:-1] + _FEW
        return T if won.sum() >= _WITNESSES and np.all(after >= _KEPT * before - _FEW) else None

    def held_pose(self, T_world_rig: Array) -> Array | None:
        """The pose refined, if most corners agree with it, and points that would be too few by themselves."""
        if len(self.seen.views) < _LEAST_POINTS:
            return None
        T = self.refined_pose(T_world_rig)
        *of_views, points = self._agreeing(T).tolist()
        corners = sum(of_views)
        most = points >= _SHARE_POINTS * len(self.seen.views) and corners >= _SHARE_CORNERS * len(self.pairs)
        enough = points + corners / 2 >= self.config.min_inliers  # a corner tells one number, not two
        return T if most and enough and points >= _LEAST_POINTS else None

    def refined_pose(self, T_world_rig: Array) -> Array:
        """The pose (4, 4) of least reprojections of points and epipolar distances of corners that moved.

        Gauss-Newton with Cauchy losses, which begin wide.
        """
        T_last, pairs = se3.inverse(self.T_world_last), self.pairs.take(self.pairs.move())
        for looseness in _LOOSENESS:
            residual, J = linearise(T_world_rig, self.seen, self.optics)
            beside = pairs.epipolar_errors(T_last @ T_world_rig, self.optics)
            ahead, back = np.split(pairs.epipolar_errors(T_last @ T_world_rig @ _NUDGES, self.optics), 2)
            slope = (ahead - back).T / (2.0 * _STEP)
            points = looseness * self.config.pixel_sigma
            corners = _CORNERS * points
            w = 1.0 / (points**2 + np.sum(residual**2, axis=1))
            v = 1.0 / (corners**2 + beside**2)
            H = np.einsum("n,nij,nik->jk", w, J, J) + np.einsum("n,nj,nk->jk", v, slope, slope)
            g = np.einsum("n,nij,ni->j", w, J, residual) + slope.T @ (v * beside)
            T_world_rig = T_world_rig @ se3.exp(-np.linalg.solve(H + 1e-9 * np.trace(H) * np.eye(6), g))
        return np.asarray(T_world_rig)

    def _agreeing(self, T_world_rig: Array) -> Array:
        """How many corners of each view fit a pose, and how many points."""
        fits = self.pairs.fit(se3.inverse(self.T_world_last) @ T_world_rig, self.optics)
        corners = np.bincount(self.pairs.views[fits], minlength=self.optics.n_views)
        off = linearise_sight(T_world_rig, *self.seen[:3], self.optics)[0]
        return np.append(corners, np.count_nonzero(np.linalg.norm(off, axis=1) < self.config.gate))
