"""First estimates: the lens and the pose of every board, each sighting taken as if there were no mirrors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from facetcam.calibration import lens
from facetcam.calibration.boards import BoardSet
from facetcam.calibration.free_optics import FreeOptics
from facetcam.calibration.least_squares import Prior, minimise
from facetcam.calibration.plane_pose import plane_pose
from facetcam.calibration.problem import Looks, State, subset
from facetcam.calibration.sightings import Sighting
from facetcam.geometry import se3
from facetcam.geometry.reflection import FLIP_X
from facetcam.rig import Camera

Array = NDArray[np.float64]

LEAST_CORNERS = 4
_FLATTEST = 0.02  # least ratio of the two spreads of a sighting's corners: a pose needs an area
_LOSSES = (20.0, 3.0, 1.0)  # pixels
_MOST = 250  # sightings from which the lens is first estimated; more only take time


def usable(sighting: Sighting, boards: BoardSet) -> bool:
    """Tell whether the corners span an area, so that they give a pose."""
    if len(sighting) < LEAST_CORNERS:
        return False
    flat = boards.boards[sighting.board].points[sighting.corners, :2]
    spread = np.linalg.svd(flat - flat.mean(axis=0), compute_uv=False)
    return bool(spread[1] > _FLATTEST * spread[0] and spread[1] > 0)


def is_mirrored(sighting: Sighting, boards: BoardSet) -> bool:
    """Tell from the order of the corners whether the image of the board is a mirror image."""
    flat = boards.boards[sighting.board].points[sighting.corners, :2]
    design = np.column_stack([flat, np.ones(len(flat))])
    affine = np.linalg.lstsq(design, sighting.pixels, rcond=None)[0]
    return bool(np.linalg.det(affine[:2]) < 0)


def poses_apart(
    camera: Camera, focal_tolerance: float, sightings: Sequence[Sighting], boards: BoardSet
) -> tuple[Camera, Array, Array]:
    """Lens and board poses from sightings that know nothing of each other (Zhang's calibration).

    Returns
    -------
    camera : Camera
        A better guess of the intrinsics.
    T_image_board : (S, 4, 4) array
        Signed: of determinant -1 for mirror images.
    rms : (S,) array
        Residual of each sighting, pixels.
    """
    flipped = np.array([is_mirrored(s, boards) for s in sightings], dtype=np.int64)
    first = [_plane_pose(camera, s, boards, bool(f)) for s, f in zip(sightings, flipped)]
    looks = Looks.of(
        [s.pixels for s in sightings],
        [boards.boards[s.board].points[s.corners] for s in sightings],
        flipped.tolist(),
        [0] * len(sightings),
        list(range(len(sightings))),
    )
    optics = FreeOptics.of([np.eye(4), FLIP_X])
    state = State(camera.model, lens.values_of(camera), optics, np.eye(4)[None], np.array(first))
    prior = Prior(lens.values_of(camera), lens.tolerances(camera, focal_tolerance))
    few, part, _ = subset(looks, state, _largest(sightings))
    free = np.arange(state.shared) < len(state.intrinsics)
    for loss in _LOSSES:
        part = minimise(part, few, free, prior, loss, 15)
    state = replace(state, intrinsics=part.intrinsics)
    state = minimise(state, looks, np.zeros_like(free), prior, _LOSSES[1], 30)
    squares = np.sum((looks.pixels - state.predict(looks)) ** 2, axis=1)
    rms = np.array([np.sqrt(np.median(squares[a:b])) for a, b in looks.bounds])
    signed = np.where(flipped[:, None, None] == 1, FLIP_X @ state.T_rig_station, state.T_rig_station)
    return lens.camera_of(state.intrinsics, camera), signed, rms


def _largest(sightings: Sequence[Sighting]) -> list[int]:
    """Indices of the sightings with the most corners."""
    order = np.argsort([-len(s) for s in sightings], kind="stable")[:_MOST]
    return sorted(order.tolist())


def _plane_pose(camera: Camera, sighting: Sighting, boards: BoardSet, flipped: bool) -> Array:
    """Proper pose of a board from one sighting, its image flipped if it is a mirror image."""
    rays = camera.ray(sighting.pixels)
    if flipped:
        rays = rays * (-1.0, 1.0, 1.0)
    # Rays turned to the middle of the sighting all pass a plane before it, even those of a fisheye's edge.
    turn = _turn_to_axis(rays.sum(axis=0))
    rays = rays @ turn.T
    rays = rays / np.maximum(rays[:, 2:], 0.05)
    points = boards.boards[sighting.board].points[sighting.corners]
    T = plane_pose(points, rays[:, :2])
    if T is None:
        ahead = np.array([0.0, 0.0, 10.0 * float(np.ptp(points, axis=0).max())])
        T = se3.from_rotation_translation(np.eye(3), ahead - points.mean(axis=0))
    return se3.from_rotation_translation(turn.T, np.zeros(3)) @ T


def _turn_to_axis(direction: Array) -> Array:
    """Rotation (3, 3) that brings a direction to the optical axis."""
    z = direction / max(float(np.linalg.norm(direction)), 1e-12)
    helper = np.array([1.0, 0.0, 0.0]) if abs(z[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    x = np.cross(helper, z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z])
