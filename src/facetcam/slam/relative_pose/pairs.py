"""Corners of two frames that are taken for the same points, and what a motion between them explains."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from facetcam.features import match_windowed
from facetcam.geometry import se3
from facetcam.geometry.triangulation import triangulate_two_rays
from facetcam.slam.camera.frame import Corners
from facetcam.slam.camera.optics import Optics
from facetcam.slam.config import SlamConfig
from facetcam.slam.relative_pose.epipolar import epipolar_error

Array = NDArray[np.float64]
Index = NDArray[np.int64]

EPIPOLAR_GATE = 2.0  # px
CLEAR_PARALLAX = 0.01  # radians that a pure rotation cannot explain
_SEARCH = 0.3  # of the frame's width
START_PARALLAX = 0.02  # radians that give a point its depth
SLIGHT_PARALLAX = 0.005  # and that tell at least that there is a way
_ROTATION_STEPS = 10
_STILL = 1.0  # px by which pairs of a rig that stands may seem to move
_IN_SIGHT = 0.2  # share of a view's corners matched, below which what it showed is out of sight
_FEW = 20  # corners of a view that tell nothing of it


@dataclass(slots=True)
class Pairs:
    """Corners of two frames taken for the same points: view, and position on its ideal pinhole in both."""

    views: NDArray[np.int8]
    plane_a: Array
    plane_b: Array

    @classmethod
    def of(cls, a: Corners, rows_a: Index, b: Corners, rows_b: Index) -> Pairs:
        """Pairs of corner rows."""
        return cls(a.views[rows_a], a.plane[rows_a], b.plane[rows_b])

    @classmethod
    def linked(cls, a: Corners, b: Corners, hits: Index) -> Pairs:
        """Pairs of the corners of a with those of b that `hits` (N,) names, -1 for none."""
        rows = np.flatnonzero(hits >= 0)
        return cls.of(a, rows, b, hits[rows])

    @classmethod
    def none(cls) -> Pairs:
        """No pairs."""
        return cls(np.empty(0, np.int8), np.empty((0, 2)), np.empty((0, 2)))

    def __len__(self) -> int:
        return len(self.views)

    def take(self, rows: NDArray[np.generic]) -> Pairs:
        """Some of the pairs."""
        return Pairs(self.views[rows], self.plane_a[rows], self.plane_b[rows])

    def without(self, views: Index) -> Pairs:
        """The pairs of all other views."""
        return self.take(~np.isin(self.views, views)) if len(views) else self

    def move(self) -> NDArray[np.bool_]:
        """Pairs (N,) that are not at the same place in both frames."""
        return np.asarray(np.linalg.norm(self.plane_b - self.plane_a, axis=1) > _STILL)

    def stand(self, T_a_b: Array, optics: Optics) -> NDArray[np.bool_]:
        """Pairs (N,) at the same place in both frames, though a motion's turn moves even what is far away."""
        turns = (optics.T_view_rig @ se3.inverse(T_a_b) @ optics.T_rig_view)[self.views, :3, :3]
        a = np.column_stack([self.plane_a / optics.focal, np.ones(len(self))])
        far = np.einsum("nij,nj->ni", turns, a)
        moved = np.linalg.norm(optics.focal * far[:, :2] / far[:, 2:] - self.plane_a, axis=1)
        return np.asarray((moved > 2.0 * _STILL) & ~self.move())

    def fit(self, T_a_b: Array, optics: Optics) -> NDArray[np.bool_]:
        """Pairs (N,) that a motion explains; (K, N) for K motions."""
        return np.asarray(np.abs(self.epipolar_errors(T_a_b, optics)) < EPIPOLAR_GATE)

    def misfit(self, T_a_b: Array, optics: Optics) -> Array:
        """Mean distance in pixels from what a motion says, cut off where a pair does not fit; (K,) for K."""
        return np.asarray(
            np.minimum(np.abs(self.epipolar_errors(T_a_b, optics)), EPIPOLAR_GATE).mean(axis=-1)
        )

    def epipolar_errors(self, T_a_b: Array, optics: Optics) -> Array:
        """Signed Sampson distances (N,) in pixels from a motion of the rig; (K, N) for K motions."""
        error = np.empty((*T_a_b.shape[:-2], len(self)))
        for view in np.unique(self.views):
            rows = self.views == view
            error[..., rows] = epipolar_error(
                self.plane_a[rows], self.plane_b[rows], int(view), T_a_b, optics
            )
        return error

    def parallax(self, T_a_b: Array, optics: Optics) -> tuple[Array, Array]:
        """Distance (N,) from frame a, negative where rays part, and angle (N,) between the rays."""
        origins = optics.origins(self.views)
        rays_a, rays_b = (optics.plane_rays(p, self.views) for p in (self.plane_a, self.plane_b))
        _, distance, other, angle = triangulate_two_rays(
            origins, rays_a, se3.transform(T_a_b, origins), rays_b @ T_a_b[:3, :3].T
        )
        return np.where(other > 0, distance, -1.0), angle

    def pure_rotation(self, optics: Optics) -> tuple[Array, Array]:
        """Best rotation (3, 3) of the rig on the spot, and the angles (N,) it leaves between the rays."""
        a, b = (optics.plane_rays(p, self.views) for p in (self.plane_a, self.plane_b))
        weight = np.ones(len(a))
        for _ in range(_ROTATION_STEPS):
            rotation, _ = Rotation.align_vectors(a, b, weights=weight)
            angle = np.linalg.norm(np.cross(a, rotation.apply(b)), axis=1)
            weight = 1.0 / (1.0 + (angle / CLEAR_PARALLAX) ** 2)
        return rotation.as_matrix(), angle

    def count_good(
        self, T_a_b: Array, optics: Optics, gate: float, parallax: float = START_PARALLAX
    ) -> Index:
        """Pairs of each view that fit a motion, lie in front of the view and have that parallax."""
        distance, angle = self.parallax(T_a_b, optics)
        fits = np.abs(self.epipolar_errors(T_a_b, optics)) < gate
        good = self.views[fits & (distance > 0) & (angle > parallax)]
        return np.bincount(good, minlength=optics.n_views)


def alike(a: Corners, b: Corners, config: SlamConfig) -> Index:
    """Row (N,) of the corner of b that looks like each of a, in the same view and not far from it, or -1."""
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
    return np.asarray(hits, np.int64)


def match_corners(a: Corners, b: Corners, config: SlamConfig) -> Pairs:
    """Corners of two frames that look alike, less those that may be anywhere on an edge."""
    return Pairs.linked(a, b, np.where(a.slide, -1, alike(a, b, config)))


def in_sight(a: Corners, pairs: Pairs) -> bool:
    """Tell whether most views still show what they did: one that is frozen or full of people counts once."""
    corners, matched = (np.bincount(views, minlength=128) for views in (a.views, pairs.views))
    rows = corners >= _FEW
    return bool(rows.any() and np.median(matched[rows] / corners[rows]) >= _IN_SIGHT)
