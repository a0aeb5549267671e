"""Pose of a flat board from one image, whatever is known of it besides."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam.geometry import se3

Array = NDArray[np.float64]


def plane_pose(flat: Array, image: Array) -> Array | None:
    """The likelier of the two poses that explain the image of a plane (infinitesimal plane-based, IPPE).

    Parameters
    ----------
    flat : (N, 3) array
        Points of the plane z = 0, metres.
    image : (N, 2) array
        Where their rays meet the plane one before the camera.

    Returns
    -------
    T_cam_board : (4, 4) array or None
        None where no pose is found.
    """
    middle = flat.mean(axis=0)
    found, turns, shifts, _ = cv2.solvePnPGeneric(
        flat - middle, np.ascontiguousarray(image), np.eye(3), None, flags=cv2.SOLVEPNP_IPPE
    )
    if not found or not np.isfinite(shifts[0]).all():
        return None
    R = cv2.Rodrigues(turns[0])[0]
    return se3.from_rotation_translation(R, shifts[0].ravel() - R @ middle)
