"""Wheels that count in a metre of their own, beside a map whose scale is known more or less well."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from facetcam.geometry import se3
from facetcam.slam.adjustment.wheel_steps import WheelSteps
from facetcam.slam.camera.frame import Corners
from facetcam.slam.map.map import Keyframe, Observations
from facetcam.slam.odometry.planar import planar_pose

Array = NDArray[np.float64]


def driven(wheels_metre: float, count: int = 20) -> list[Keyframe]:
    """Keyframes along a bow, with odometry that counts so much for a metre."""
    s = 0.4 * np.arange(count)
    rows = np.column_stack([s, 0.3 * np.sin(s), 0.2 * np.sin(0.7 * s)])
    keyframes = [
        Keyframe(k, float(k), planar_pose(row), Corners.none(), None, row * [wheels_metre, wheels_metre, 1.0])
        for k, row in enumerate(rows)
    ]
    for keyframe in keyframes:
        see(keyframe, 30)
    return keyframes


def see(keyframe: Keyframe, count: int) -> None:
    """Let a keyframe see so many points of the map, the first ones."""
    at = np.zeros((count, 2))
    keyframe.observations = Observations(np.arange(count), np.zeros(count, np.int8), at, at)


@pytest.mark.parametrize("metre", [0.5, 0.95, 1.3])
def test_where_images_know_the_scale_wheels_count_in_their_own_metre(metre: float) -> None:
    steps, keyframes = WheelSteps(0.3), driven(metre)
    steps.compare(keyframes, scale_sigma=0.002)
    assert steps.metre == pytest.approx(metre, rel=0.005)
    for step in steps.between(keyframes):
        way = np.linalg.norm(keyframes[step.j].T_world_rig[:3, 3] - keyframes[step.i].T_world_rig[:3, 3])
        assert np.linalg.norm(step.T_i_j[:3, 3]) == pytest.approx(way, rel=0.005)


def test_where_images_cannot_tell_the_scale_a_metre_is_a_metre() -> None:
    steps = WheelSteps(0.3)
    steps.compare(driven(1.2), scale_sigma=np.inf)
    assert steps.metre == 1.0


def test_between_the_two_the_better_known_one_counts_for_more() -> None:
    """By inverse variances: wheels are taken to be off by 3 %."""
    steps = WheelSteps(0.3)
    steps.compare(driven(1.05), scale_sigma=0.03)
    assert np.log(steps.metre) == pytest.approx(0.5 * np.log(1.05), rel=1e-6)


def test_steps_that_slip_do_not_count() -> None:
    keyframes = driven(1.04)
    for keyframe in keyframes[8:]:  # it spins once
        assert keyframe.odometry is not None
        keyframe.odometry[0] += 3.0
    steps = WheelSteps(0.3)
    steps.compare(keyframes, scale_sigma=0.001)
    assert steps.metre == pytest.approx(1.04, rel=0.005)
    assert 8 not in [step.j for step in steps.between(keyframes)]


def test_too_few_steps_tell_nothing() -> None:
    steps = WheelSteps(0.3)
    for count in (0, 1, 4):
        steps.compare(driven(1.3, count), scale_sigma=0.001)
        assert steps.metre == 1.0


def astray(points: int, wheels_metre: float = 1.0, count: int = 20) -> list[Keyframe]:
    """Keyframes of which the ninth, which sees so many points, is a metre and half a radian off."""
    keyframes = driven(wheels_metre, count)
    see(keyframes[8], points)
    keyframes[8].T_world_rig = keyframes[8].T_world_rig @ se3.exp([0.0, 0.0, 0.5, 1.0, 0.0, 0.0])
    return keyframes


@pytest.mark.parametrize(("points", "denied"), [(5, set()), (20, {8, 9})])
def test_images_that_hardly_place_a_keyframe_deny_no_wheels(points: int, denied: set[int]) -> None:
    """A keyframe of a rig that spun had floated a metre away from where its wheels had been."""
    believed = {step.j for step in WheelSteps(0.3).between(astray(points))}
    assert believed == set(range(1, 20)) - denied


def test_wheels_that_images_deny_elsewhere_are_not_believed_in_the_dark() -> None:
    keyframes = astray(5)
    for keyframe in keyframes:
        assert keyframe.odometry is not None
        keyframe.odometry[2] *= -3.0
    assert WheelSteps(0.3).between(keyframes) == []
