"""Bundle adjustment of rig poses and points; the work is done by the native core."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam import _core
from facetcam.slam.camera.nuisances import Nuisances
from facetcam.slam.camera.optics import Optics
from facetcam.slam.camera.sight import across, seen_edges

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(slots=True)
class RelativePose:
    """A measured motion `T_i_j` of two frames.

    Attributes
    ----------
    covariance : (6, 6) array
        Of a small rotation (rad) and translation (m) in frame j.
    loss_scale : float
        Standard deviations beyond which a Cauchy loss flattens; inf for plain least squares.
    """

    i: int
    j: int
    T_i_j: Array
    covariance: Array
    loss_scale: float = np.inf


@dataclass(slots=True)
class Bundle:
    """Frames, points and what the frames saw of them.

    Attributes
    ----------
    T_world_rig : (K, 4, 4) array
        Frame poses; those with `fixed` set are held.
    points : (P, 3) array
        World points in metres.
    frame, view, point : (M,) int arrays
        Indices of each observation, in the order of the frames.
    plane : (M, 2) array
        Where it was seen, in pixels of the view's ideal pinhole (`Optics.plane`).
    motions : list of RelativePose
        Odometry between frames.
    bridges : list of RelativePose
        Those of them that join frames with hardly a point in common: nothing else may hold these together.
    nuisances : Nuisances or None
        What is estimated with the map, by which `plane` has been corrected; None where it is held.
    edge : (M, 2) array or None
        As of `Sights`; None where all points are corners.
    """

    T_world_rig: Array
    fixed: NDArray[np.bool_]
    points: Array
    frame: Index
    view: Index
    point: Index
    plane: Array
    motions: list[RelativePose] = field(default_factory=list)
    bridges: list[RelativePose] = field(default_factory=list)
    nuisances: Nuisances | None = None
    edge: Array | None = None

    def on_edges(self, edges: Array, optics: Optics) -> Bundle:
        """The same of points on edges (P, 3) of the world."""
        seen = [
            seen_edges(T, self.points[self.point[rows]], self.view[rows], edges[self.point[rows]], optics)
            for T, rows in frames_of(self)
        ]
        return replace(self, edge=np.concatenate(seen))

    @property
    def edges(self) -> Array:
        """`edge`, zero for corners."""
        return np.zeros((len(self.frame), 2)) if self.edge is None else self.edge


def frames_of(bundle: Bundle) -> list[tuple[Array, slice]]:
    """Pose of each frame, and which observations are its own."""
    begin = np.searchsorted(bundle.frame, np.arange(len(bundle.T_world_rig) + 1)).tolist()
    return [(T, slice(*rows)) for T, rows in zip(bundle.T_world_rig, itertools.pairwise(begin))]


def adjust(
    bundle: Bundle,
    optics: Optics,
    loss_scale: float,
    max_iterations: int,
    tolerance: float,
    threads: int = 0,
    noise: float = 1.0,
) -> tuple[Array, Array, Array]:
    """Minimise the Cauchy-weighted reprojection error over free poses, all points and the bundle's nuisances.

    The Levenberg-Marquardt steps eliminate the points (Schur complement). Any number of threads gives
    the same bits.

    Parameters
    ----------
    loss_scale : float
        Residual in pixels beyond which the Cauchy loss flattens.
    max_iterations : int
    tolerance : float
        Relative change of the cost at which to stop.
    threads : int
        0 for all cores.
    noise : float
        Pixels that count as one standard deviation against what is expected of the nuisances.

    Returns
    -------
    T_world_rig : (K, 4, 4) array
    points : (P, 3) array
    nuisances : (N,) array
        Their values, empty where the bundle has none.
    """
    motions, nuisances = bundle.motions, bundle.nuisances
    values, weight, by = np.zeros(3), np.zeros(3), np.zeros((0, 2, 3))
    N = 0 if nuisances is None else len(nuisances.values)
    if nuisances is not None:
        values[:N], weight[:N] = nuisances.values, (noise / nuisances.sigma) ** 2
        by = np.zeros((len(bundle.frame), 2, 3))
        by[:, :, :N] = across(bundle.edges, nuisances.by)
    T_world_rig, points, values, *_ = _core.adjust_bundle(
        focal=optics.focal,
        T_view_rig=np.ascontiguousarray(optics.T_view_rig),
        T_world_rig=np.ascontiguousarray(bundle.T_world_rig),
        fixed=np.ascontiguousarray(bundle.fixed),
        points=np.ascontiguousarray(bundle.points),
        frame=np.ascontiguousarray(bundle.frame, dtype=np.int64),
        view=np.ascontiguousarray(bundle.view, dtype=np.int64),
        point=np.ascontiguousarray(bundle.point, dtype=np.int64),
        plane=np.ascontiguousarray(bundle.plane),
        edge=np.ascontiguousarray(bundle.edges),
        between=np.array([(m.i, m.j) for m in motions], np.int64).reshape(-1, 2),
        T_i_j=np.array([m.T_i_j for m in motions]).reshape(-1, 4, 4),
        roots=np.array([_whitening(m.covariance) for m in motions]).reshape(-1, 6, 6),
        motion_loss_scales=np.array([m.loss_scale for m in motions]).reshape(-1),
        by_shared=by,
        shared=values,
        shared_weight=weight,
        loss_scale=loss_scale,
        max_iterations=max_iterations,
        tolerance=tolerance,
        threads=threads or cv2.getNumThreads(),
    )
    return T_world_rig, points, values[:N]


def growth(bundle: Bundle, T_world_rig: Array, points: Array, optics: Optics) -> tuple[Array, Array]:
    """By which factors an adjustment moved points away from the views that see them.

    Returns
    -------
    of_keyframes : (K,) array
        At the median of the points that each of them sees.
    of_points : (N,) array
        From the view that saw a point first.
    """
    before = _distances(bundle, bundle.T_world_rig, bundle.points, optics)
    ratio = _distances(bundle, T_world_rig, points, optics) / np.maximum(before, 1e-9)
    rows = [ratio[bundle.frame == k] for k in range(len(T_world_rig))]
    of_points = np.ones(len(points))
    seen, first = np.unique(bundle.point, return_index=True)
    of_points[seen] = ratio[first]
    return np.array([np.median(r) if len(r) else 1.0 for r in rows]), of_points


def _distances(bundle: Bundle, T_world_rig: Array, points: Array, optics: Optics) -> Array:
    """How far (M,) from its view each observed point is."""
    T_world_view = T_world_rig[bundle.frame] @ optics.T_rig_view[bundle.view]
    return np.asarray(np.linalg.norm(points[bundle.point] - T_world_view[:, :3, 3], axis=1))


def _whitening(covariance: Array) -> Array:
    """Matrix (6, 6) that gives errors of this covariance unit variance."""
    return np.linalg.inv(np.linalg.cholesky(covariance))
