"""Rolling shutter: a frame is read row by row while the rig moves on.

The views of one frame then stem from different moments, as if they stood elsewhere on the rig: at walking
speed and a readout of 20 ms that is a centimetre, enough to spoil the scale that a small rig tells. How long
the readout takes is estimated with the map, zero for a global shutter.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from facetcam.slam.camera.optics import Optics
from facetcam.slam.camera.sight import Sights, linearise

Array = NDArray[np.float64]

LONGEST_READOUT = 0.05  # seconds, of any camera
READOUT_SIGMA = 0.02  # seconds from the first row to the last, before anything is known


def sweep(
    T_world_rig: Array, velocity: Array, xyz: Array, view: NDArray[np.int8], pixels: Array, optics: Optics
) -> Array:
    """Shift (N, 2) on the ideal pinholes, in pixels per second of readout, of points seen by a moving rig.

    Parameters
    ----------
    T_world_rig : (4, 4) array
        When the middle row is read.
    velocity : (6,) array
        Right-hand twist a second.
    xyz : (N, 3) array
        World points.
    view, pixels : (N,), (N, 2) arrays
        Where they are seen on the raw frame.
    """
    if not np.any(velocity):
        return np.zeros((len(xyz), 2))
    _, J = linearise(T_world_rig, Sights.of_corners(xyz, view, np.zeros((len(xyz), 2))), optics)
    height = optics.camera.height
    late = (pixels[:, 1] - (height - 1) / 2.0) / max(height - 1, 1)
    return np.asarray(late[:, None] * (J @ velocity))


def at_one_moment(
    T_world_rig: Array,
    velocity: Array,
    xyz: Array,
    view: NDArray[np.int8],
    pixels: Array,
    readout: float,
    optics: Optics,
) -> Array:
    """Where points seen at `pixels` lie on the ideal pinholes (N, 2), as a global shutter would show them.

    `readout` is in seconds, the rest as in `sweep`.
    """
    plane = optics.plane(pixels, view)
    return plane - readout * sweep(T_world_rig, velocity, xyz, view, pixels, optics) if readout else plane
