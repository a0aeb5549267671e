"""How well the images determine the map, and the metre."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from facetcam.rig import RigCovariance
from facetcam.slam.adjustment.bundle import Bundle
from facetcam.slam.adjustment.information import information
from facetcam.slam.camera.optics import Optics
from facetcam.slam.threads import on_one_thread

Array = NDArray[np.float64]

_NULL = 1e-10  # information below this share of the largest is rounding
_NULL_SHARE = 1e-4
_LEAST_BESIDE = 30  # points in further views that can prove a scale: a few may all be mistaken


@dataclass(frozen=True, slots=True)
class MapUncertainty:
    """What the images leave open of a map whose first frame is held.

    Attributes
    ----------
    scale_sigma : float
        Relative standard deviation of the scale; inf where the images cannot tell it: one central camera, no
        motion, or hardly a point in any other view.
    covariance : (K, 6, 6) array
        Of right-hand twists of the frames; where the scale is unknown, at the scale that the map has.
    nuisance_step : (N,) array
        By which other nuisances would explain the images better.
    nuisance_covariance : (N, N) array
    """

    scale_sigma: float
    covariance: Array
    nuisance_step: Array = field(default_factory=lambda: np.zeros(0))
    nuisance_covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))


@on_one_thread
def map_uncertainty(bundle: Bundle, optics: Optics, pixel_sigma: float) -> MapUncertainty:
    """Uncertainty of a map from the information in its reprojections, and from what is open of its rig.

    That of the scale is how far all frames can move towards or away from the first one together while
    rotations and points follow. The rig's covariance (`Rig.covariance`) goes into both; a rig without one
    counts as exact.
    """
    K = len(bundle.T_world_rig)
    centres = bundle.T_world_rig[:, :3, 3] - bundle.T_world_rig[0, :3, 3]
    if K < 2 or np.linalg.norm(centres) < 1e-6:
        return MapUncertainty(np.inf, np.zeros((K, 6, 6)))
    open_ = free_frames(bundle, optics, pixel_sigma)
    covariance = np.concatenate([np.zeros((1, 6, 6)), open_.covariance])
    # A scale change moves each frame along its own axes by R' (c_k - c_0).
    scale = np.zeros((K - 1, 6))
    scale[:, 3:] = np.einsum("kji,kj->ki", bundle.T_world_rig[1:, :3, :3], centres[1:])
    direction = scale.ravel() / np.sum(scale**2)
    if np.sum((direction @ open_.unseen) ** 2) > _NULL_SHARE * np.sum(direction**2):
        return MapUncertainty(np.inf, covariance, open_.nuisance_step, open_.nuisance_covariance)
    sigma = float(np.linalg.norm(direction @ open_.spread))
    proven = sigma < 1.0 and _points_beside(bundle) >= _LEAST_BESIDE
    told = sigma if proven else np.inf
    return MapUncertainty(told, covariance, open_.nuisance_step, open_.nuisance_covariance)


def _points_beside(bundle: Bundle) -> int:
    """Count the points seen in other views than the one that sees most: the metre comes from these."""
    seen = np.zeros((int(bundle.view.max()) + 1, len(bundle.points)), dtype=bool)
    seen[bundle.view, bundle.point] = True
    seen[seen.sum(axis=1).argmax()] = False
    return int(seen.any(axis=0).sum())


@dataclass(frozen=True, slots=True)
class FreeFrames:
    """What is open of the F frames of a bundle that are not held.

    Attributes
    ----------
    spread : (6F, N) array
        Independent errors of one standard deviation, as right-hand twists of all frames together.
    unseen : (6F, M) array
        Orthonormal directions of which the images tell nothing; `spread` leaves them out.
    nuisance_step, nuisance_covariance : (N,), (N, N) arrays
        As in `MapUncertainty`.
    """

    spread: Array
    unseen: Array
    nuisance_step: Array
    nuisance_covariance: Array

    @property
    def covariance(self) -> Array:
        """Of each frame, (F, 6, 6)."""
        half = self.spread.reshape(-1, 6, self.spread.shape[1])
        return np.asarray(half @ np.swapaxes(half, 1, 2))


def free_frames(bundle: Bundle, optics: Optics, pixel_sigma: float) -> FreeFrames:
    """Uncertainty of the frames of a bundle against those that are held, which come first."""
    first = 6 * int(np.count_nonzero(bundle.fixed))
    found = information(bundle, optics, pixel_sigma, optics.rig.covariance)
    values, vectors = np.linalg.eigh(found.poses[first:, first:])
    known = values > _NULL * values[-1]
    seen = vectors[:, known] / np.sqrt(values[known])
    wrong_rig = -seen @ (seen.T @ found.joint[first:]) @ _root(optics.rig.covariance)
    own = found.nuisances
    poses_step = -seen @ (seen.T @ found.pose_gradient[first:])
    step = -np.linalg.solve(own.weight, own.gradient + own.by_pose[first:].T @ poses_step)
    by_poses = np.linalg.solve(own.weight, own.by_pose[first:].T @ seen)
    covariance = np.linalg.inv(own.weight) + by_poses @ by_poses.T
    spread = np.column_stack([seen, wrong_rig])
    return FreeFrames(spread, vectors[:, ~known], step, covariance)


def _root(known: RigCovariance | None) -> Array:
    """Matrix L (R, R) such that L L' is the covariance of a rig's numbers in standard deviations."""
    if known is None:
        return np.zeros((0, 0))
    sigma = np.sqrt(np.diag(known.matrix))
    values, vectors = np.linalg.eigh(known.matrix / np.outer(sigma, sigma))
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
