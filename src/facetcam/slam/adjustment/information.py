"""What the reprojections say of poses and rig, with all points eliminated (Schur complement)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from facetcam.geometry import se3
from facetcam.rig import Rig, RigCovariance
from facetcam.rig.covariance import MOTIONS
from facetcam.rig.freedom import moved
from facetcam.slam.adjustment.bundle import Bundle, frames_of
from facetcam.slam.camera.optics import Optics
from facetcam.slam.camera.sight import Sights, across, coordinates, linearise, linearise_sight

Array = NDArray[np.float64]

_STEP = 0.1  # standard deviations by which a number of the rig is moved for its derivative


@dataclass(frozen=True, slots=True)
class Eliminated:
    """Equations of the nuisances: by each pose (6K, N), weight (N, N), gradient (N,); their prior counts."""

    by_pose: Array
    weight: Array
    gradient: Array


@dataclass(frozen=True, slots=True)
class Information:
    """Normal equations of poses, as right-hand twists, and of the rig's numbers in standard deviations.

    Attributes
    ----------
    poses : (6K, 6K) array
    joint : (6K, R) array
    rig : (R, R) array
    pose_gradient, rig_gradient : (6K,), (R,) arrays
    nuisances : Eliminated
        What they say of the bundle's nuisances, which are eliminated too.
    """

    poses: Array
    joint: Array
    rig: Array
    pose_gradient: Array
    rig_gradient: Array
    nuisances: Eliminated


def information(
    bundle: Bundle, optics: Optics, pixel_sigma: float, known: RigCovariance | None = None
) -> Information:
    """Reduce a bundle to its poses and, where `known` names them, the rig's numbers."""
    K, P, M = len(bundle.T_world_rig), len(bundle.points), len(bundle.frame)
    residual, J, by_point = linearise_all(bundle, bundle.points[bundle.point], optics)
    weight = _weights(residual, pixel_sigma)
    root = np.sqrt(weight)[:, None, None] / max(_noise(bundle, residual, weight), 1e-3)
    by_rig = np.zeros((M, 2, 0)) if known is None else rig_derivatives(bundle, J, optics, known)
    R, own = by_rig.shape[2], bundle.nuisances
    if own is not None:
        by_rig = np.concatenate([by_rig, across(bundle.edges, own.by)], axis=2)
    A, B = _blocks(root * J, bundle.frame, K), _blocks(root * by_point, bundle.point, P)
    C, r = (root * by_rig).reshape(2 * M, -1), (root[:, :, 0] * residual).ravel()
    B = B @ _whitening((B.T @ B).tobsr((3, 3)), P)
    W, rest, pull = A.T @ B, B.T @ C, B.T @ r
    poses = np.asarray((A.T @ A - W @ W.T).todense()) + _across(bundle)
    joint, rig = A.T @ C - W @ rest, C.T @ C - rest.T @ rest
    pose_gradient, rig_gradient = A.T @ r - W @ pull, C.T @ r - rest.T @ pull
    prior = np.zeros(0) if own is None else own.sigma**-2
    u, w = joint[:, R:], rig[:R, R:]
    h = rig[R:, R:] + np.diag(prior)
    g = rig_gradient[R:] + prior * (0.0 if own is None else own.values)
    return Information(
        poses=poses - u @ np.linalg.solve(h, u.T),
        joint=joint[:, :R] - u @ np.linalg.solve(h, w.T),
        rig=rig[:R, :R] - w @ np.linalg.solve(h, w.T),
        pose_gradient=pose_gradient - u @ np.linalg.solve(h, g),
        rig_gradient=rig_gradient[:R] - w @ np.linalg.solve(h, g),
        nuisances=Eliminated(u, h, g),
    )


def typical_noise(bundle: Bundle, optics: Optics, pixel_sigma: float) -> float:
    """Pixels by which the measurements of a bundle would err, were those of a point independent."""
    residual, _ = linearise_points(bundle, bundle.points[bundle.point], optics)
    return _noise(bundle, residual, _weights(residual, pixel_sigma))


def _weights(residual: Array, pixel_sigma: float) -> Array:
    return np.asarray(1.0 / (1.0 + np.sum(residual**2, axis=1) / pixel_sigma**2))


def _noise(bundle: Bundle, residual: Array, weight: Array) -> float:
    """Standard deviation of residuals (M, 2) with robust weights, were those of a point independent.

    All measurements of a point come from one reference patch: they count as one, not as many.
    """
    squared = np.sum(weight * np.sum(residual**2, axis=1)) / (weight @ coordinates(bundle.edges))
    return float(np.sqrt(len(bundle.frame) / len(bundle.points) * squared))


def _across(bundle: Bundle) -> Array:
    """What wheels say of poses (6K, 6K) where nothing else joins two parts of a bundle."""
    K = len(bundle.T_world_rig)
    total = np.zeros((K, 6, K, 6))
    for bridge in bundle.bridges:
        i, j, weight = bridge.i, bridge.j, np.linalg.inv(bridge.covariance)
        T_j_i = se3.inverse(bundle.T_world_rig[j]) @ bundle.T_world_rig[i]
        back = -se3.adjoint(T_j_i)  # a twist of frame i, seen from j
        total[j, :, j] += weight
        total[i, :, i] += back.T @ weight @ back
        total[i, :, j] += back.T @ weight
        total[j, :, i] += weight @ back
    return total.reshape(6 * K, 6 * K)


def linearise_all(bundle: Bundle, xyz: Array, optics: Optics) -> tuple[Array, Array, Array]:
    """Residuals of the observations of a bundle, of points at `xyz` (M, 3), and their derivatives.

    Returns
    -------
    residual : (M, 2) array
        Pixels on the ideal pinholes, as far as they count (`Sights`).
    by_pose : (M, 2, 6) array
        By right-hand twists of the frames.
    by_point : (M, 2, 3) array
    """
    M = len(bundle.frame)
    residual, by_pose, by_point = np.zeros((M, 2)), np.zeros((M, 2, 6)), np.zeros((M, 2, 3))
    for T, rows in frames_of(bundle):
        seen = Sights(xyz[rows], bundle.view[rows], bundle.plane[rows], bundle.edges[rows])
        residual[rows], by_pose[rows] = linearise(T, seen, optics)
        by_point[rows] = -by_pose[rows][:, :, 3:] @ T[:3, :3].T  # a point moves against the rig
    return residual, by_pose, by_point


def linearise_points(bundle: Bundle, xyz: Array, optics: Optics) -> tuple[Array, Array]:
    """Residuals and their derivatives by the points alone, as `linearise_all` gives them."""
    M = len(bundle.frame)
    residual, by_point = np.zeros((M, 2)), np.zeros((M, 2, 3))
    for T, rows in frames_of(bundle):
        sight = linearise_sight(T, xyz[rows], bundle.view[rows], bundle.plane[rows], optics)
        residual[rows], by_point[rows] = sight[0], sight[1] @ T[:3, :3].T
    return across(bundle.edges, residual), across(bundle.edges, by_point)


def rig_derivatives(bundle: Bundle, by_pose: Array, optics: Optics, known: RigCovariance) -> Array:
    """Change (M, 2, R) of each residual by one standard deviation of each of the rig's numbers.

    A mirror that moves carries the virtual cameras behind it along: a residual changes by the motion of its
    own one as by one of the rig, for which `by_pose` (M, 2, 6) stands. For what else changes, the ideal
    pinholes follow: on others the residuals, being measured in other units, would seem to want another lens.
    """
    sigma = np.sqrt(np.diag(known.matrix))
    pixels = optics.pixels(bundle.plane, bundle.view)
    R, t = bundle.T_world_rig[bundle.frame, :3, :3], bundle.T_world_rig[bundle.frame, :3, 3]
    points_rig = np.einsum("nji,nj->ni", R, bundle.points[bundle.point] - t)
    out = np.zeros((len(pixels), 2, len(sigma)))
    for index, (name, step) in enumerate(zip(known.parameters, _STEP * np.diag(sigma))):
        both = [moved(optics.rig, known, s) for s in (step, -step)]
        if name.partition(": ")[2] in MOTIONS:
            out[:, :, index] = np.einsum("mij,mj->mi", by_pose, _view_twists(*both)[bundle.view])
        else:
            seen = points_rig, pixels, bundle.view
            ahead, back = (_residuals(*seen, optics.adapted(rig)) for rig in both)
            out[:, :, index] = across(bundle.edges, ahead - back)
    return out / (2.0 * _STEP)


def _view_twists(ahead: Rig, back: Rig) -> Array:
    """Motion (V, 6) of the virtual cameras from one rig to another, as twists of the rig's own frame."""
    steps = [ahead.T_rig_image(name) @ se3.inverse(back.T_rig_image(name)) for name in ahead.view_names]
    return np.stack([se3.log(T) for T in steps])


def _residuals(points_rig: Array, pixels: Array, view: NDArray[np.int64], optics: Optics) -> Array:
    return np.asarray(optics.to_plane(points_rig, view)[0] - optics.plane(pixels, view))


def _blocks(values: Array, column: NDArray[np.int64], n_columns: int) -> sparse.csr_matrix:
    """Sparse matrix with one dense block a row-block, in the given block column."""
    rows, height, width = values.shape
    matrix = sparse.bsr_matrix(
        (values, column, np.arange(rows + 1)), shape=(rows * height, n_columns * width)
    )
    return matrix.tocsr()


def _whitening(V: sparse.bsr_matrix, count: int) -> sparse.bsr_matrix:
    """Root L of the inverse L L' of a matrix of (3, 3) blocks on the diagonal.

    Products with the inverse itself would lose the little that is told of a point which is seen in one
    direction alone, and what is lost poses as information.
    """
    blocks = np.zeros((count, 3, 3))
    row = np.repeat(np.arange(count), np.diff(V.indptr))
    diagonal = row == V.indices
    blocks[row[diagonal]] = V.data[diagonal]
    values, vectors = np.linalg.eigh(blocks)
    damped = np.maximum(values, 0.0) + 1e-9 + 1e-14 * values[:, -1:]  # more would pose as information, too
    root = vectors / np.sqrt(damped)[:, None, :]
    return sparse.bsr_matrix((root, np.arange(count), np.arange(count + 1)), shape=(3 * count, 3 * count))
