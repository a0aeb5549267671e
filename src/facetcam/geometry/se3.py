"""Rigid motions as 4x4 matrices: `T_a_b` maps coordinates of frame b into frame a."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from facetcam.errors import FacetcamError

Array = NDArray[np.float64]


def assert_proper_rotation(R: ArrayLike, what: str = "rotation", tolerance: float = 1e-6) -> Array:
    """Return `R` as float64, or raise when it is not a rotation of determinant +1.

    Stands at every border where a mirror image (determinant -1) would be taken for a rotation in silence.

    Parameters
    ----------
    R : (3, 3) array
    what : str
        Name used in the message.
    tolerance : float
        Largest deviation of R R' from the identity.

    Raises
    ------
    FacetcamError
        If R is not 3x3, not finite, not orthonormal or has determinant -1.
    """
    R = np.asarray(R, dtype=np.float64)
    if R.shape != (3, 3) or not np.all(np.isfinite(R)):
        raise FacetcamError(f"{what}: expected a finite 3x3 matrix, got shape {R.shape}")
    if np.abs(R @ R.T - np.eye(3)).max() > tolerance:
        raise FacetcamError(f"{what}: not a rotation, its rows are not orthonormal within {tolerance:g}")
    if np.linalg.det(R) < 0:
        raise FacetcamError(f"{what}: a mirror image (determinant -1), not a rotation; flip one axis first")
    return R


def inverse(T: Array) -> Array:
    """Inverse of a rigid (proper or mirrored) 4x4 motion, or of a stack (..., 4, 4)."""
    R_transposed = np.swapaxes(T[..., :3, :3], -1, -2)
    out = np.zeros_like(T)
    out[..., :3, :3] = R_transposed
    out[..., :3, 3] = -(R_transposed @ T[..., :3, 3, None])[..., 0]
    out[..., 3, 3] = 1.0
    return out


def transform(T: Array, points: ArrayLike) -> Array:
    """Map points (N, 3) by one motion (4, 4)."""
    moved: Array = np.asarray(points, dtype=np.float64) @ T[:3, :3].T + T[:3, 3]
    return moved


def from_rotation_translation(R: ArrayLike, t: ArrayLike) -> Array:
    """Build a 4x4 motion from R (3, 3) and t (3,)."""
    T = np.eye(4)
    T[:3, :3] = R
    T[:3, 3] = t
    return T


def orthonormalized(T: Array) -> Array:
    """The rigid motion nearest to a 4x4 matrix whose rotation has drifted by rounding."""
    U, _, Vt = np.linalg.svd(T[:3, :3])
    return from_rotation_translation(U @ Vt, T[:3, 3])


def skew(v: Array) -> Array:
    """Cross-product matrices (..., 3, 3) of vectors (..., 3)."""
    v = np.asarray(v, dtype=np.float64)
    out = np.zeros((*v.shape, 3))
    out[..., 2, 1] = v[..., 0]
    out[..., 0, 2] = v[..., 1]
    out[..., 1, 0] = v[..., 2]
    return out - np.swapaxes(out, -1, -2)


def _left_jacobian(phi: Array) -> Array:
    angle = np.linalg.norm(phi, axis=-1)[..., None, None]
    K = skew(phi)
    small = angle < 1e-6  # the closed form divides by angle^3
    safe = np.where(small, 1.0, angle)
    a = np.where(small, 0.5, (1.0 - np.cos(safe)) / safe**2)
    b = np.where(small, 1.0 / 6.0, (safe - np.sin(safe)) / safe**3)
    jacobian: Array = np.eye(3) + a * K + b * K @ K
    return jacobian


def exp(xi: ArrayLike) -> Array:
    """Motions (..., 4, 4) of twists.

    Parameters
    ----------
    xi : (..., 6) array
        Rotation vector in radians, then the translation part in metres.
    """
    xi = np.asarray(xi, dtype=np.float64)
    T = np.zeros((*xi.shape[:-1], 4, 4))
    T[..., :3, :3] = (
        Rotation.from_rotvec(xi[..., :3].reshape(-1, 3)).as_matrix().reshape(*xi.shape[:-1], 3, 3)
    )
    T[..., :3, 3] = (_left_jacobian(xi[..., :3]) @ xi[..., 3:, None])[..., 0]
    T[..., 3, 3] = 1.0
    return T


def log(T: Array) -> Array:
    """Twist (6,) of a proper motion: the inverse of `exp` for rotations below pi."""
    phi = _rotation_vector(assert_proper_rotation(T[:3, :3], "log of a motion", 1e-5))
    return np.concatenate([phi, np.linalg.solve(_left_jacobian(phi), T[:3, 3])])


def _rotation_vector(R: Array) -> Array:
    """Rotation vector (3,): SciPy's, in closed form where the antisymmetric part shows the axis."""
    twice = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    sine, cosine = math.sqrt(twice @ twice), float(R[0, 0] + R[1, 1] + R[2, 2]) - 1.0
    if cosine < 0.0:
        return np.asarray(Rotation.from_matrix(R).as_rotvec(), dtype=np.float64)
    return twice * (math.atan2(sine, cosine) / sine if sine > 0.0 else 0.5)


def adjoint(T: Array) -> Array:
    """Matrix (6, 6) that takes a twist (rotation, translation) through T, as T exp(xi) = exp(A xi) T."""
    R = T[:3, :3]
    A = np.zeros((6, 6))
    A[:3, :3] = A[3:, 3:] = R
    A[3:, :3] = skew(T[:3, 3]) @ R
    return A


def from_quaternion_xyzw(quaternion_xyzw: ArrayLike, translation: ArrayLike) -> Array:
    """Build a 4x4 motion from a quaternion (x, y, z, w) of any length above zero and a translation."""
    R = Rotation.from_quat(np.asarray(quaternion_xyzw, dtype=np.float64)).as_matrix()
    return from_rotation_translation(R, translation)


def to_quaternion_xyzw(T: Array) -> Array:
    """Quaternion (x, y, z, w) of a proper motion, with w >= 0 so that the sign is one."""
    R = assert_proper_rotation(T[:3, :3], "quaternion of a motion", 1e-5)
    return np.asarray(Rotation.from_matrix(R).as_quat(canonical=True), dtype=np.float64)
