"""When a tracked frame becomes a keyframe."""

from __future__ import annotations

import numpy as np
import pytest

from facetcam.slam.config import SlamConfig
from facetcam.slam.frame import Corners
from facetcam.slam.keyframes import is_due
from facetcam.slam.map import Keyframe
from facetcam.slam.measure import Measurements, Predictions
from facetcam.slam.pose import Pose
from facetcam.slam.tracking import Fix

CONFIG = SlamConfig(keyframe_points=100, keyframe_overlap=0.8)


def fix(found: int) -> Fix:
    """A pose from so many measurements."""
    views, pixels = np.zeros(found, np.int8), np.zeros((found, 2))
    expected = Predictions(np.arange(found), views, pixels, np.zeros((found, 2, 2)))
    seen = Measurements(np.arange(found), views, pixels, pixels)
    return Fix(Pose(np.eye(4), np.eye(6), np.zeros(found)), expected, seen)


def nearest(measured: int) -> Keyframe:
    keyframe = Keyframe(0, 0.0, np.eye(4), Corners.none(), None, None)
    keyframe.measured = measured
    return keyframe


@pytest.mark.parametrize(
    ("found", "measured", "distance", "due"),
    [
        (300, 300, 0.5, False),  # much is found, and little has changed
        (300, 300, 1.1, True),  # moved or turned
        (200, 300, 0.1, True),  # a third of the points is gone
        (50, 50, 0.5, True),  # hardly any are left: the next step may lose these
        (50, 50, 0.1, False),  # but from here nothing new is to be seen
    ],
)
def test_new_points_are_due(found: int, measured: int, distance: float, due: bool) -> None:
    assert is_due(fix(found), nearest(measured), distance, CONFIG) is due
