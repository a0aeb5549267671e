"""What tracking says of each frame."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Status(enum.Enum):
    """How the pose of a frame was found."""

    STARTING = "STARTING"
    TRACKING = "TRACKING"
    DEAD_RECKONING = "DEAD_RECKONING"
    LOST = "LOST"
    DROPPED = "DROPPED"  # not looked at, to keep up with real time


@dataclass(frozen=True, slots=True)
class ViewHealth:
    """Map points expected in a view, and those measured there and kept."""

    predicted: int
    inliers: int


@dataclass(frozen=True, slots=True)
class State:
    """The answer to one frame.

    Attributes
    ----------
    timestamp : float
        Seconds.
    status : Status
    T_world_rig : (4, 4) array or None
        None where no pose is known; the world is the rig at the first frame of the map.
    covariance : (6, 6) array or None
        Of a small rotation (rad) and translation (m) in the rig frame; of a frame without metric scale in
        the units of the map.
    views : dict of str to ViewHealth
    keyframe : bool
    metric : bool
        True where the scale of the map is proven.
    scale_sigma : float
        Relative standard deviation of the scale, inf where unknown or where the images deny the rig.
    map_points : int
    map : int
        Number of the map in whose world the pose is: another one after a loss for good, until both meet.
    pixels : (M, 2) float32 array
        Raw-frame positions of the measurements kept.
    pixel_views : (M,) int8 array
        Their view indices.
    """

    timestamp: float
    status: Status
    T_world_rig: Array | None = None
    covariance: Array | None = None
    views: dict[str, ViewHealth] = field(default_factory=dict)
    keyframe: bool = False
    metric: bool = False
    scale_sigma: float = np.inf
    map_points: int = 0
    map: int = 0
    pixels: NDArray[np.float32] = field(default_factory=lambda: np.empty((0, 2), np.float32))
    pixel_views: NDArray[np.int8] = field(default_factory=lambda: np.empty(0, np.int8))
