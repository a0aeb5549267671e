"""A rig that the wheels carry through darkness to where nothing of its map is in sight."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2
from slam_worlds import folded

from facetcam.evaluation.trajectory import evaluate
from facetcam.geometry import se3
from facetcam.simulation.drive import Drive, round_the_table, wheel_odometry
from facetcam.simulation.film import Film, renderer_of
from facetcam.simulation.room import furnished_room
from facetcam.slam import Slam, State, Status

FRAMES, DARK = 42, range(18, 24)
WITHIN = 12  # frames after the darkness


@pytest.fixture(scope="module")
def drive() -> Drive:
    return round_the_table(FRAMES)


def images(drive: Drive) -> Iterator[NDArray[np.uint8]]:
    """After the darkness nothing looks as before: bright is dark, as in another room."""
    for k, image in enumerate(Film(folded(), renderer_of(furnished_room()), drive)):
        yield np.zeros_like(image) if k in DARK else image if k < DARK.start else 255 - image


@pytest.fixture(scope="module")
def tracked(drive: Drive) -> tuple[Slam, list[State]]:
    slam, states, wheels = Slam(folded()), [], wheel_odometry(drive)
    for k, image in enumerate(images(drive)):
        states.append(slam.track(image, drive.times[k], wheels[k]))
    slam.finish()
    return slam, states


def test_the_map_goes_on(tracked: tuple[Slam, list[State]], drive: Drive) -> None:
    slam, states = tracked
    statuses = [state.status for state in states]
    assert statuses[DARK.start : DARK.stop] == [Status.DEAD_RECKONING] * len(DARK)
    again = DARK.stop + WITHIN
    assert statuses[again:] == [Status.TRACKING] * (FRAMES - again)
    found = evaluate(slam.trajectory(), (drive.times, drive.poses), max_gap=0.001)
    assert found.matched == FRAMES
    assert found.ate.max < 0.05


def test_poses_beyond_the_gap_are_as_unsure_as_the_wheels(
    tracked: tuple[Slam, list[State]], drive: Drive
) -> None:
    _, states = tracked
    before, last = states[DARK.start - 1], states[-1]
    assert before.T_world_rig is not None and last.T_world_rig is not None
    assert before.covariance is not None and last.covariance is not None
    own = se3.inverse(before.T_world_rig) @ last.T_world_rig
    true = se3.inverse(drive.poses[DARK.start - 1]) @ drive.poses[-1]
    error = se3.log(se3.inverse(true) @ own)
    assert error @ np.linalg.solve(last.covariance, error) < chi2.ppf(0.9973, 6)
    assert np.all(np.diag(last.covariance) > np.diag(before.covariance))
