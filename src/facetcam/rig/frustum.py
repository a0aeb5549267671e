"""Outlines of mirror pyramids and frusta, and a plain camera to look at them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from facetcam.errors import RigError
from facetcam.geometry import se3
from facetcam.rig.camera import BROWN_CONRADY, Camera

Array = NDArray[np.float64]

_SIDES = ("front", "left", "back", "right")


def face_names(faces: int) -> tuple[str, ...]:
    """Front, left, back, right for four faces; others face1, face2, ... counter-clockwise from the front."""
    return _SIDES if faces == 4 else tuple(f"face{i + 1}" for i in range(faces))


def regular_outline(faces: int, inradius: float) -> Array:
    """Corners (faces, 2), counter-clockwise; the first edge lies in front (y > 0)."""
    if faces < 3 or not (math.isfinite(inradius) and inradius > 0):
        raise RigError(
            f"a rig takes three or more faces and a radius above zero, got {faces} and {inradius:g}"
        )
    step = math.tau / faces
    azimuth = math.pi / 2 + step * (np.arange(faces) - 0.5)
    return inradius / math.cos(step / 2) * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)


def inset(corners: Array, distance: float) -> Array:
    """Shrink a convex counter-clockwise polygon: every edge moves inwards by `distance`."""
    along = np.roll(corners, -1, axis=0) - corners
    inward = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.linalg.norm(along, axis=1, keepdims=True)
    offset = np.einsum("ij,ij->i", inward, corners) + distance
    pairs = np.stack([np.roll(inward, 1, axis=0), inward], axis=1)
    inner = np.linalg.solve(pairs, np.stack([np.roll(offset, 1), offset], axis=1)[..., None])[..., 0]
    if np.any(np.einsum("ij,ij->i", np.roll(inner, -1, axis=0) - inner, along) <= 0):
        raise RigError(f"facets that reach {distance * 1e3:.0f} mm inwards cross each other; lower the depth")
    return inner


def at_height(points: Array, z: float) -> Array:
    """Points (N, 2) lifted to (N, 3)."""
    return np.column_stack([points, np.full(len(points), z)])


def looking_at(centre: ArrayLike, target: ArrayLike) -> Array:
    """Pose of a camera whose image has the rig's +y, or its +z, upwards."""
    forward = np.subtract(target, centre)
    forward = forward / np.linalg.norm(forward)
    right = np.array([1.0, 0.0, 0.0])
    return se3.from_rotation_translation(np.column_stack([right, np.cross(forward, right), forward]), centre)


def pinhole(focal: float, width: int = 1600, height: int = 1200) -> Camera:
    """A camera without distortion, its centre amid the sensor."""
    return Camera(BROWN_CONRADY, width, height, focal, focal, (width - 1) / 2, (height - 1) / 2, (0.0,) * 5)
