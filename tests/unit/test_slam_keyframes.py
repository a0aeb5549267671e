"""When a tracked frame becomes a keyframe."""

from __future__ import annotations

import numpy as np
import pytest

from facetcam.slam.camera.frame import Corners
from facetcam.slam.camera.pose import Pose
from facetcam.slam.config import SlamConfig
from facetcam.slam.map.map import Keyframe
from facetcam.slam.map.measure import Measurements, Predictions
from facetcam.slam.tracking.fix import Fix
from facetcam.slam.tracking.keyframes import is_due

CONFIG = SlamConfig(keyframe_points=150, keyframe_overlap=0.8)


def fix(found: int, expected: int) -> Fix:
    """A pose from so many measurements of so many points in sight."""
    views, pixels = np.zeros(expected, np.int8), np.zeros((expected, 2))
    in_sight = Predictions(np.arange(expected), views, pixels, np.zeros((expected, 2, 2)))
    seen = Measurements(np.arange(found), views[:found], pixels[:found], pixels[:found])
    return Fix(Pose(np.eye(4), np.eye(6), np.zeros(found)), in_sight, seen)


def nearest(measured: int) -> Keyframe:
    keyframe = Keyframe(0, 0.0, np.eye(4), Corners.none(), None, None)
    keyframe.measured = measured
    return keyframe


@pytest.mark.parametrize(
    ("found", "expected", "measured", "distance", "due"),
    [
        (300, 400, 300, 0.5, False),  # much is found, and little has changed
        (300, 400, 300, 1.1, True),  # moved or turned
        (200, 400, 300, 0.1, True),  # a third of the points is gone
        (50, 60, 50, 0.5, True),  # hardly any are left: the next step may lose these
        (50, 60, 50, 0.3, False),  # but from here nothing new is to be seen
        (40, 100, 40, 0.3, True),  # unless these few are about to hold no pose any more
        (40, 100, 40, 0.1, False),  # if there is anything new at all
        (40, 300, 40, 0.3, False),
        (50, 300, 50, 0.5, False),  # many are there, in the dark: it will come to light again
    ],
)
def test_new_points_are_due(found: int, expected: int, measured: int, distance: float, due: bool) -> None:
    assert is_due(fix(found, expected), nearest(measured), distance, CONFIG) is due
