"""A right pose sought from a little beside it, against a wrong one to which more points have moved."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from numpy.typing import NDArray

from facetcam.geometry import se3
from facetcam.slam.camera.frame import Frame
from facetcam.slam.camera.pose import Pose
from facetcam.slam.map.map import Map
from facetcam.slam.map.measure import Measurements, Predictions
from facetcam.slam.tracking.fix import Fix
from facetcam.slam.tracking.localiser import Localiser
from facetcam.slam.tracking.motion import Motion
from facetcam.slam.tracking.relocaliser import Relocaliser
from facetcam.slam.tracking.tracker import Tracker

Array = NDArray[np.float64]

RIGHT = np.eye(4)
FURTHER = se3.exp([0.0, 0.0, 0.0, 0.0, 1.5, 0.0])
PREDICTED, WRONG = (se3.exp([0.0, turn, 0.0, way, 0.0, 0.0]) for turn, way in ((0.003, 0.005), (0.016, 0.02)))


def fix(T: Array, found: int, residual: float) -> Fix:
    point, view, two = np.arange(found), np.zeros(found, np.int8), np.zeros((found, 2))
    expected = Predictions(np.arange(220), np.zeros(220, np.int8), np.zeros((220, 2)), np.zeros((220, 2, 2)))
    return Fix(
        Pose(T, 1e-6 * np.eye(6), np.full(found, residual)), expected, Measurements(point, view, two, two)
    )


class Scene(Tracker):
    """Of the right pose patches find 150 points from beside it and 190 from itself, of the wrong one 180."""

    def __init__(self) -> None:
        self.looks = 0

    def locate(self, frame: Frame, predicted: Array, *_: object, **__: object) -> Fix:  # type: ignore[override]
        self.looks += 1
        if np.allclose(predicted, WRONG):
            return fix(WRONG, 180, 0.32)
        return fix(RIGHT, 190 if np.allclose(predicted, RIGHT) else 150, 0.3)

    def chosen(self, moved: Array) -> Fix:
        """Of what is found from a prediction beside the right pose, and where points have `moved`."""
        frame = cast(Frame, None)
        best = self._or_moved(self.locate(frame, PREDICTED), moved, frame, np.zeros(6))
        assert best is not None
        return best


def test_the_right_pose_gets_a_second_look() -> None:
    found = Scene().chosen(WRONG)
    np.testing.assert_allclose(found.T_world_rig, RIGHT)
    assert len(found.seen) == 190


@pytest.mark.parametrize(("turned", "looks"), [(0.001, 1), (0.004, 2)])
def test_poses_that_agree_need_none(turned: float, looks: int) -> None:
    """Where points have moved to the pose that was found there is no look from there."""
    scene = Scene()
    found = scene.chosen(RIGHT @ se3.exp([0.0, turned, 0.0, 0.001, 0.0, 0.0]))
    assert scene.looks == looks
    np.testing.assert_allclose(found.T_world_rig, RIGHT)


class Carpet(Tracker):
    """A floor that repeats: 190 points of a pose further on agree sharply, 130 of the right one less so."""

    def __init__(self) -> None:
        self._relocaliser = cast(Relocaliser, self)

    def propose(self, *_: object) -> list[Array]:
        return [RIGHT, FURTHER]

    def locate_from_afar(self, frame: Frame, guess: Array, *_: object, **__: object) -> Fix:  # type: ignore[override]
        return fix(FURTHER, 190, 0.3) if np.allclose(guess, FURTHER) else fix(RIGHT, 130, 2.0)

    def chosen(self, *predicted: Array) -> Array:
        found = self._relocate(cast(Frame, None), np.zeros(6), *predicted)
        assert found is not None
        return found.T_world_rig


def test_what_repeats_elsewhere_does_not_win_over_a_pose_where_the_rig_should_be() -> None:
    np.testing.assert_allclose(Carpet().chosen(PREDICTED), RIGHT)


def test_where_nothing_says_where_the_rig_should_be_the_sharper_pose_wins() -> None:
    np.testing.assert_allclose(Carpet().chosen(), FURTHER)


class Pane(Localiser):
    """Corners of the last keyframe put a pose one window pane further on."""

    def __init__(self) -> None:
        self.went_back = False
        self._tracker = cast(Tracker, SimpleNamespace(confirmed=lambda *_: fix(FURTHER, 40, 1.0)))
        self._map = cast(Map, SimpleNamespace(young=False, keyframes=[None]))
        self._motion = cast(Motion, SimpleNamespace(go_back=lambda _: setattr(self, "went_back", True)))

    def chosen(self, told: tuple[Array, Array] | None) -> Array:
        found = self._second_look(cast(Frame, None), fix(RIGHT, 60, 0.5), np.zeros(6), told)
        assert found is not None
        return found.T_world_rig


def test_no_second_look_puts_a_pose_where_wheels_cannot_have_come() -> None:
    doubt = np.diag([1e-4, 1e-4, 1e-4, 1e-2, 1e-2, 1e-2])
    by_wheels, by_sight, slipped = Pane(), Pane(), Pane()
    np.testing.assert_allclose(by_wheels.chosen((RIGHT, doubt)), RIGHT)
    assert not by_wheels.went_back
    np.testing.assert_allclose(by_sight.chosen(None), FURTHER)
    np.testing.assert_allclose(slipped.chosen((FURTHER, doubt)), FURTHER)
    assert by_sight.went_back and slipped.went_back
