"""Where the next frame is expected."""

from __future__ import annotations

import numpy as np

from facetcam.geometry import se3
from facetcam.slam.camera.frame import Corners
from facetcam.slam.map.map import Keyframe
from facetcam.slam.tracking.motion import Motion, Start

NOD = np.array([0.05, 0.02, 0.0, 0.0, 0.0, 0.01])  # pitch, roll and height, which wheels do not see
AHEAD = np.array([0.0, 0.0, 0.1, 0.0, 0.2, 0.0])


def started(twist: np.ndarray) -> Motion:
    """A rig that made this motion in the last second."""
    first, last = (Keyframe(k, k, se3.exp(k * twist), Corners.none(), None, None) for k in (0, 1))
    motion = Motion()
    motion.begin(Start(first, last, [], se3.exp(twist), 1.0))
    motion.odometry = np.zeros(3)
    return motion


def test_a_rig_without_wheels_goes_on_as_it_went() -> None:
    (found,) = started(AHEAD + NOD).predictions(2.0, None)
    np.testing.assert_allclose(found, se3.exp(2.0 * (AHEAD + NOD)), atol=1e-12)


def test_wheels_tell_the_way_on_the_floor_and_inertia_the_rest() -> None:
    motion = started(NOD)
    found = motion.predictions(2.0, np.array([0.2, 0.0, 0.0]))[0]
    step = se3.log(se3.inverse(se3.exp(NOD)) @ found)
    np.testing.assert_allclose(step, [*NOD[:2], 0.0, 0.0, 0.2, NOD[5]], atol=1e-9)


def test_on_a_flat_floor_the_wheels_tell_all() -> None:
    motion = started(AHEAD)
    found = motion.predictions(2.0, np.array([0.1, 0.0, 0.3]))[0]
    turn, way = se3.exp([0, 0, 0.3, 0, 0, 0]), se3.inverse(se3.exp(AHEAD)) @ found
    np.testing.assert_allclose(way[:3, :3], turn[:3, :3], atol=1e-9)
    np.testing.assert_allclose(way[:3, 3], [0.0, 0.1, 0.0], atol=1e-9)
