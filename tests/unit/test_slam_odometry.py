"""Wheel odometry against what the images say: slip, jumps, clock, unit and sign of known drives."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from slam_worlds import by_wheels, folded, spoiled, true_pairs

from facetcam.geometry import se3
from facetcam.slam.camera.optics import Optics
from facetcam.slam.odometry.check import OdometryCheck
from facetcam.slam.odometry.planar import believable, planar_motion, planar_pose
from facetcam.slam.relative_pose.confirmed_motion import confirmed_motion

Array = NDArray[np.float64]


def drive(times: Array) -> Array:
    """x, y, yaw (N, 3) of a robot that winds and now and then stands."""
    yaw = 0.8 * np.sin(0.9 * times) + 0.5 * np.sin(2.3 * times + 1.0)
    speed = 0.4 * (1.0 + np.sin(0.5 * times))
    step = np.gradient(times)
    return np.column_stack(
        [np.cumsum(speed * np.cos(yaw) * step), np.cumsum(speed * np.sin(yaw) * step), yaw]
    )


def poses_of(rows: Array) -> Array:
    return np.array([planar_pose(row) for row in rows])


def judged(wheels: Array, frames: int = 150, metric: bool = False) -> OdometryCheck:
    """The check after a drive at 10 frames/s, with 2 mrad of noise in the poses."""
    times = np.arange(frames) / 10
    rng = np.random.default_rng(5)
    check = OdometryCheck()
    for t, T, row in zip(times, poses_of(drive(times)), wheels):
        check.offer(t, T @ se3.exp([0, 0, rng.normal(0, 0.002), 0, 0, 0]), row, metric)
    return check


TIMES = np.arange(150) / 10


@pytest.mark.parametrize("offset", [-1.3, -0.3, 0.2, 0.9])
def test_a_wrong_clock_is_measured(offset: float) -> None:
    found = judged(drive(TIMES - offset)).offset  # the row of a time stands at a later one
    assert found is not None
    assert abs(found - offset) < 0.03


@pytest.mark.parametrize("stretch", [0.9, 1.0, 1.15])
def test_wheels_on_the_right_clock_are_left_alone(stretch: float) -> None:
    check = judged(drive(TIMES) * [1.0, 1.0, stretch])
    assert check.offset is None and not check.complaint


def test_wheels_that_were_blocked_for_long_are_no_foreign_ones() -> None:
    wheels = drive(TIMES)
    wheels[40:85] = wheels[40]
    assert not judged(wheels).complaint


@pytest.mark.parametrize(
    ("factor", "agrees"),
    [(1.0, True), (1.04, True), (0.0, False), (1000.0, False), (0.5, False), (-1.0, False)],
)
def test_wheels_are_asked_in_the_dark_where_they_went_as_the_images_did(factor: float, agrees: bool) -> None:
    assert judged(drive(TIMES) * [factor, factor, 1.0]).agrees == agrees


@pytest.mark.parametrize(("factor", "few", "foretells"), [(1.0, 2, True), (-1.0, 2, True), (-1.0, 20, False)])
def test_wheels_foretell_until_the_images_go_another_way(factor: float, few: int, foretells: bool) -> None:
    check = judged(drive(TIMES) * [factor, factor, 1.0], few)
    assert check.foretells is foretells
    assert not check.agrees  # in the dark more is asked


def test_a_steady_turn_tells_nothing_of_the_clock() -> None:
    check, rate = OdometryCheck(), 0.4
    for t in TIMES:
        row, later = (np.array([0.0, 0.0, rate * (t + lag)]) for lag in (0.0, 0.7))
        check.offer(t, planar_pose(row), later)
    assert check.offset is None and not check.complaint


@pytest.mark.parametrize(
    ("wheels", "complaint"),
    [
        (drive(TIMES) * [1.0, 1.0, -1.0], "the other way"),
        (np.degrees(drive(TIMES) * 0.3), "radians"),
        (drive(np.sqrt(TIMES) * 7.0), "not those of the film"),
    ],
)
def test_foreign_wheels_are_refused(wheels: Array, complaint: str) -> None:
    seen = judged(wheels) if "radians" not in complaint else _slowly(wheels)
    assert complaint in seen.complaint


@pytest.mark.parametrize(("metric", "factor"), [(False, 1000.0), (False, 0.01), (True, 3.28)])
def test_a_wrong_unit_of_length_is_refused(metric: bool, factor: float) -> None:
    check = judged(drive(TIMES) * [factor, factor, 1.0], metric=metric)
    assert "x and y are in metres" in check.complaint
    assert float(check.complaint.split()[2]) == pytest.approx(factor, rel=0.1)  # "it goes 3.28 times ..."


def test_a_unit_that_a_guessed_scale_let_pass_is_refused_once_the_scale_is_proven() -> None:
    check = judged(drive(TIMES) * [3.28, 3.28, 1.0])
    assert not check.complaint
    check.conclude(metric=False)
    assert not check.complaint
    check.conclude(metric=True)
    assert "x and y are in metres" in check.complaint


@pytest.mark.parametrize("wheels", [drive(TIMES) * [-1, -1, 1], drive(TIMES)[:, [1, 0, 2]] * [-1, 1, 1]])
def test_another_way_is_refused(wheels: Array) -> None:
    """Backwards, and sideways."""
    assert "another way than the film" in judged(wheels).complaint


def test_slip_and_jumps_make_no_wrong_unit() -> None:
    steps = np.diff(drive(TIMES), axis=0)
    steps[40:70, :2] *= 3.0
    steps[90, :2] += 3.0
    assert not judged(np.vstack([np.zeros(3), np.cumsum(steps, axis=0)]), metric=True).complaint


def test_of_a_foreign_drive_nothing_is_believed() -> None:
    """Steps of it that agree do so by chance."""
    true = drive(np.arange(0, 20, 0.5))
    foreign = drive(np.arange(40, 60, 0.5)) * [1.0, 1.0, -1.0]
    assert not believable(foreign, poses_of(true), sigma=0.3).any()
    assert not believable(true * [1000.0, 1000.0, 1.0], poses_of(true), sigma=0.3).any()
    assert not believable(np.zeros_like(true), poses_of(true), sigma=0.3).any()


def _slowly(wheels: Array) -> OdometryCheck:
    """A drive of gentle turns, so that degrees do not run over half a turn between frames."""
    check = OdometryCheck()
    for t, row, wheel in zip(TIMES, drive(TIMES) * [1.0, 1.0, 0.3], wheels):
        check.offer(t, planar_pose(row), wheel)
    return check


def test_slip_jumps_and_blocked_wheels_are_not_believed() -> None:
    true = drive(np.arange(0, 20, 0.5))
    wheels = true * [1.04, 1.04, 1.0]  # a scale of their own is no slip
    steps = np.diff(wheels, axis=0)
    steps[5, :2] *= 3.0  # spinning
    steps[9, :2] += 1.0  # a jump
    steps[14] = 0.0  # blocked
    steps[20, 2] += 0.5  # a turn that was none
    wheels = np.vstack([wheels[:1], wheels[0] + np.cumsum(steps, axis=0)])
    wheels[30] = np.nan  # no row
    believed = believable(wheels, poses_of(true), sigma=0.3)
    wrong = {5, 9, 14, 20, 29, 30}
    assert not believed[sorted(wrong)].any()
    # After the false turn the wheels' frame is turned, which changes no step.
    assert believed[[i for i in range(len(believed)) if i not in wrong]].all()


def test_a_way_in_another_direction_is_not_believed() -> None:
    true = drive(np.arange(0, 20, 0.5))
    sideways = np.column_stack([-true[:, 1], true[:, 0], true[:, 2]])
    moved = np.linalg.norm(np.diff(true[:, :2], axis=0), axis=1) > 0.1
    assert not believable(sideways, poses_of(true), sigma=0.3)[moved].any()


def test_images_correct_the_turn_of_the_wheels_and_keep_their_length() -> None:
    optics, rng = Optics(folded(), 8.0), np.random.default_rng(8)
    true, _ = planar_motion(np.zeros(3), np.array([0.3, 0.05, 0.1]), 0.3)
    pairs = spoiled(true_pairs(optics, true, rng, 800), optics, rng, 0.15, 0.3)
    wheels = true @ se3.exp([0, 0, 0.15, 0, 0, 0])
    motion = confirmed_motion(pairs, by_wheels(wheels), optics)
    assert motion is not None
    turn = se3.log(se3.inverse(true) @ motion)[:3]
    assert np.degrees(np.linalg.norm(turn)) < 0.2
    assert np.linalg.norm(motion[:3, 3]) == pytest.approx(np.linalg.norm(true[:3, 3]), rel=0.25)


@pytest.mark.parametrize("wheels", [(0.3, 0.05, -0.4), (0.1, 0.02, 0.1), (1.0, 0.15, 0.1)])
def test_images_that_see_quite_another_motion_deny_the_wheels(wheels: tuple[float, float, float]) -> None:
    """Turned the other way, a third of the way, three times the way."""
    optics, rng = Optics(folded(), 8.0), np.random.default_rng(10)
    true, _ = planar_motion(np.zeros(3), np.array([0.3, 0.05, 0.1]), 0.3)
    pairs = spoiled(true_pairs(optics, true, rng, 800), optics, rng, 0.15, 0.3)
    measured, _ = planar_motion(np.zeros(3), np.array(wheels), 0.3)
    assert confirmed_motion(pairs, by_wheels(measured), optics) is None


def test_pairs_that_fit_no_motion_deny_the_wheels() -> None:
    optics, rng = Optics(folded(), 8.0), np.random.default_rng(9)
    true, _ = planar_motion(np.zeros(3), np.array([0.3, 0.05, 0.1]), 0.3)
    pairs = spoiled(true_pairs(optics, true, rng, 800), optics, rng, 1.0, 0.3)
    assert confirmed_motion(pairs, by_wheels(true), optics) is None
