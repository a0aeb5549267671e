"""How well the images determine the map, and the metre."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from facetcam.slam.bundle import Bundle
from facetcam.slam.optics import Optics
from facetcam.slam.pose import linearise

Array = NDArray[np.float64]

_NULL = 1e-10  # information below this share of the largest is rounding
_NULL_SHARE = 1e-4


@dataclass(frozen=True, slots=True)
class MapUncertainty:
    """What the images leave open of a map whose first frame is held.

    Attributes
    ----------
    scale_sigma : float
        Relative standard deviation of the scale; inf where the images cannot tell it: one central camera, or
        no motion.
    covariance : (K, 6, 6) array
        Of right-hand twists of the frames; where the scale is unknown, at the scale that the map has.
    """

    scale_sigma: float
    covariance: Array


def map_uncertainty(bundle: Bundle, optics: Optics, pixel_sigma: float) -> MapUncertainty:
    """Uncertainty of a map from the information in its reprojections, with the points eliminated (Schur).

    That of the scale is how far all frames can move towards or away from the first one together while
    rotations and points follow.
    """
    K = len(bundle.T_world_rig)
    centres = bundle.T_world_rig[:, :3, 3] - bundle.T_world_rig[0, :3, 3]
    if K < 2 or np.linalg.norm(centres) < 1e-6:
        return MapUncertainty(np.inf, np.zeros((K, 6, 6)))
    S = _pose_information(bundle, optics, pixel_sigma)[6:, 6:]  # the first frame is held
    values, vectors = np.linalg.eigh(S)
    known = values > _NULL * values[-1]
    half = (vectors[:, known] / np.sqrt(values[known])).reshape(K - 1, 6, -1)
    covariance = np.concatenate([np.zeros((1, 6, 6)), half @ np.swapaxes(half, 1, 2)])
    # A scale change moves each frame along its own axes by R' (c_k - c_0).
    scale = np.zeros((K - 1, 6))
    scale[:, 3:] = np.einsum("kji,kj->ki", bundle.T_world_rig[1:, :3, :3], centres[1:])
    along = vectors.T @ (scale.ravel() / np.sum(scale**2))
    if np.sum(along[~known] ** 2) > _NULL_SHARE * np.sum(along**2):
        return MapUncertainty(np.inf, covariance)
    sigma = float(np.sqrt(np.sum(along[known] ** 2 / values[known])))
    return MapUncertainty(sigma if sigma < 1.0 else np.inf, covariance)


def _pose_information(bundle: Bundle, optics: Optics, pixel_sigma: float) -> Array:
    """Information (6K, 6K) of right-hand twists of the poses, with all points eliminated."""
    K, P, M = len(bundle.T_world_rig), len(bundle.points), len(bundle.frame)
    residual, J, by_point = np.zeros((M, 2)), np.zeros((M, 2, 6)), np.zeros((M, 2, 3))
    for k, T in enumerate(bundle.T_world_rig):
        rows = bundle.frame == k
        points = bundle.points[bundle.point[rows]]
        residual[rows], J[rows] = linearise(T, points, bundle.view[rows], bundle.plane[rows], optics)
        by_point[rows] = -J[rows][:, :, 3:] @ T[:3, :3].T  # a point moves against the rig
    weight = 1.0 / (1.0 + np.sum(residual**2, axis=1) / pixel_sigma**2)
    variance = float(np.sum(weight * np.sum(residual**2, axis=1)) / (2.0 * weight.sum()))
    # All measurements of a point come from one reference patch: they count as one, not as many.
    independent = P / M
    root = np.sqrt(independent * weight / max(variance, 1e-6))[:, None, None]
    A = _blocks(root * J, bundle.frame, K)
    B = _blocks(root * by_point, bundle.point, P)
    V = (B.T @ B).tobsr((3, 3))
    blocks = _diagonal_blocks(V, P)
    damping = 1e-9 + 1e-14 * np.trace(blocks, axis1=1, axis2=2)  # more would pose as information
    inverse = np.linalg.inv(blocks + damping[:, None, None] * np.eye(3))
    V_inverse = sparse.bsr_matrix((inverse, np.arange(P), np.arange(P + 1)), shape=(3 * P, 3 * P))
    W = A.T @ B
    return np.asarray((A.T @ A - W @ V_inverse @ W.T).todense())


def _blocks(values: Array, column: NDArray[np.int64], n_columns: int) -> sparse.csr_matrix:
    """Sparse matrix with one dense block a row-block, in the given block column."""
    rows, height, width = values.shape
    matrix = sparse.bsr_matrix(
        (values, column, np.arange(rows + 1)), shape=(rows * height, n_columns * width)
    )
    return matrix.tocsr()


def _diagonal_blocks(V: sparse.bsr_matrix, count: int) -> Array:
    blocks = np.zeros((count, 3, 3))
    row = np.repeat(np.arange(count), np.diff(V.indptr))
    diagonal = row == V.indices
    blocks[row[diagonal]] = V.data[diagonal]
    return blocks
