"""Keyframes bent so that a loop meets: a pose graph of rigid motions, or of similarities."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix, diags
from scipy.sparse.linalg import spsolve
from scipy.spatial.transform import Rotation

from facetcam.geometry import se3

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_ROTATION_SIGMA = 0.01  # radians an edge
_LENGTH_SIGMA = 0.02  # of an edge's length, and
_FLOOR = 0.005  # of the mean length, which short edges have too
_SCALE_SIGMA = 0.02  # of the scale, an edge
_MAX_STEPS = 30
_LEAST_GAIN = 1e-6
_DAMPING = 1e-6
_DIFFERENCE = 1e-6


@dataclass(frozen=True, slots=True)
class Edges:
    """Measured motions `T_i_j` (E, 4, 4) between nodes, with the growth (E,) of the scale from i to j."""

    i: Index
    j: Index
    T_i_j: Array
    growth: Array
    weight: Array

    @classmethod
    def between(cls, i: Index, j: Index, T_world_rig: Array, weight: Array | None = None) -> Edges:
        """Edges that want nodes to stay as they stand to each other."""
        ones = np.ones(len(i))
        T_i_j = se3.inverse(T_world_rig[i]) @ T_world_rig[j]
        return cls(i, j, T_i_j, ones, ones if weight is None else weight)

    def plus(self, i: int, j: int, T_i_j: Array, growth: float, weight: float) -> Edges:
        """One edge more."""
        return Edges(
            np.append(self.i, i),
            np.append(self.j, j),
            np.concatenate([self.T_i_j, T_i_j[None]]),
            np.append(self.growth, growth),
            np.append(self.weight, weight),
        )


def relax(T_world_rig: Array, edges: Edges, with_scale: bool) -> tuple[Array, Array]:
    """Poses that agree best with all edges, the first one held.

    Parameters
    ----------
    T_world_rig : (K, 4, 4) array
        Poses to begin with.
    edges : Edges
    with_scale : bool
        Let the scale of the map change along the way (7 degrees of freedom a node); else it is held (6).

    Returns
    -------
    T_world_rig : (K, 4, 4) array
    growth : (K,) array
        Of the map round each node.
    """
    T, growth = T_world_rig.copy(), np.ones(len(T_world_rig))
    if not len(edges.i):
        return T, growth
    size = 7 if with_scale else 6
    error = _errors(T, growth, edges)
    damping = _DAMPING
    for _ in range(_MAX_STEPS):
        step = _step(error, _jacobian(T, growth, edges, size), damping)
        tried = _moved(T, growth, np.concatenate([np.zeros((1, size)), step.reshape(-1, size)]))
        after = _errors(*tried, edges)
        if np.sum(after**2) > np.sum(error**2):
            damping *= 10.0
            continue
        gain = 1.0 - np.sum(after**2) / max(np.sum(error**2), 1e-300)
        (T, growth), error, damping = tried, after, 0.1 * damping
        if gain < _LEAST_GAIN:
            break
    return T, growth


def _step(error: Array, J: csr_matrix, damping: float) -> Array:
    """Levenberg-Marquardt: how all nodes but the first should move."""
    H = (J.T @ J).tocsc()
    return np.asarray(spsolve(H + diags(damping * H.diagonal() + 1e-12, format="csc"), -J.T @ error.ravel()))


def _moved(T: Array, growth: Array, step: Array) -> tuple[Array, Array]:
    """Poses and scales after a step: a turn of each rig, a shift in the world, a factor."""
    out = T.copy()
    out[:, :3, :3] = T[:, :3, :3] @ Rotation.from_rotvec(step[:, :3]).as_matrix()
    out[:, :3, 3] += step[:, 3:6]
    return out, growth * np.exp(step[:, 6]) if step.shape[1] == 7 else growth


def _errors(T: Array, growth: Array, edges: Edges) -> Array:
    """Errors (E, 7) of the edges in standard deviations."""
    return _edge_errors((T[edges.i], growth[edges.i]), (T[edges.j], growth[edges.j]), edges)


def _edge_errors(a: tuple[Array, Array], b: tuple[Array, Array], edges: Edges) -> Array:
    (T_a, growth_a), (T_b, growth_b) = a, b
    T = se3.inverse(T_a) @ T_b
    turn = Rotation.from_matrix(np.swapaxes(edges.T_i_j[:, :3, :3], 1, 2) @ T[:, :3, :3]).as_rotvec()
    length = np.linalg.norm(edges.T_i_j[:, :3, 3], axis=1)
    sigma = _LENGTH_SIGMA * length + _FLOOR * max(float(length.mean()), 1e-9)
    shift = (T[:, :3, 3] / growth_a[:, None] - edges.T_i_j[:, :3, 3]) / sigma[:, None]
    scale = np.log(growth_b / growth_a / edges.growth) / _SCALE_SIGMA
    return np.asarray(edges.weight[:, None] * np.column_stack([turn / _ROTATION_SIGMA, shift, scale]))


def _jacobian(T: Array, growth: Array, edges: Edges, size: int) -> csr_matrix:
    """Derivatives (7E, size (K - 1)) of the errors by differences, one edge end and direction at a time."""
    ends = [(T[n], growth[n]) for n in (edges.i, edges.j)]
    blocks = np.zeros((2, len(edges.i), 7, size))
    for end, direction in np.ndindex(2, size):
        step = np.zeros((len(edges.i), size))
        step[:, direction] = _DIFFERENCE
        for sign in (1.0, -1.0):
            pair = list(ends)
            pair[end] = _moved(*ends[end], sign * step)
            blocks[end, :, :, direction] += sign * _edge_errors(pair[0], pair[1], edges) / (2 * _DIFFERENCE)
    nodes = np.stack([edges.i, edges.j])[:, :, None, None]
    row = 7 * np.arange(len(edges.i))[:, None, None] + np.arange(7)[:, None]
    row, column, value = np.broadcast_arrays(row, size * (nodes - 1) + np.arange(size), blocks)
    free = column >= 0
    shape = (7 * len(edges.i), size * (len(T) - 1))
    return coo_matrix((value[free], (row[free], column[free])), shape=shape).tocsr()
