"""Real time: mapping in a thread of its own, frames dropped when behind; and the same result without."""

from __future__ import annotations

import threading
import time

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from slam_worlds import folded

from facetcam.errors import FacetcamError
from facetcam.evaluation.trajectory import evaluate
from facetcam.simulation.drive import Drive, round_the_table, wheel_odometry
from facetcam.simulation.film import Film, renderer_of
from facetcam.simulation.room import furnished_room
from facetcam.slam import Slam, SlamConfig, Status
from facetcam.slam.mapping.mapper import Mapper

Array = NDArray[np.float64]

FRAMES = 13
SOON = 60.0


class Shot:
    """A short drive round the table."""

    def __init__(self) -> None:
        self.drive: Drive = round_the_table(30)
        film = Film(folded(), renderer_of(furnished_room()), self.drive)
        self.rig = film.rig
        self.images = [image for _, image in zip(range(FRAMES), film)]
        self.wheels: Array = wheel_odometry(self.drive)

    def feed(self, slam: Slam, k: int) -> Status:
        return slam.track(self.images[k], self.drive.times[k], self.wheels[k]).status


@pytest.fixture(scope="module")
def shot() -> Shot:
    return Shot()


def real_time(shot: Shot) -> Slam:
    return Slam(shot.rig, SlamConfig(real_time=True))


def background_threads() -> int:
    return sum(thread.name == "facetcam-background" for thread in threading.enumerate())


def test_the_result_is_the_same_to_the_byte_whatever_the_threads(shot: Shot) -> None:
    results = []
    before = cv2.getNumThreads()
    try:
        for threads in (1, 2, 3):
            cv2.setNumThreads(threads)
            slam = Slam(shot.rig)
            for k in range(FRAMES):
                shot.feed(slam, k)
            slam.finish()
            results.append(b"".join(part.tobytes() for part in (*slam.trajectory(), *slam.cloud())))
    finally:
        cv2.setNumThreads(before)
    assert results[0] == results[1] == results[2]
    assert len(slam.trajectory()[0]) == FRAMES


def test_mapping_beside_tracking_is_as_accurate(shot: Shot) -> None:
    slam = real_time(shot)
    start = time.perf_counter() - shot.drive.times[0]
    for k in range(FRAMES):
        while time.perf_counter() < start + 4.0 * shot.drive.times[k]:  # a slow machine drops none either
            time.sleep(0.005)
        slam.track(shot.images[k], 4.0 * shot.drive.times[k], shot.wheels[k])
    slam.finish()
    assert background_threads() == 0
    times, poses = slam.trajectory()
    truth = (shot.drive.times, shot.drive.poses)
    assert len(times) >= FRAMES - slam.dropped - 2
    assert len(slam.keyframe_poses) >= 3
    assert evaluate((times / 4.0, poses), truth, max_gap=0.001).ate_scaled.rmse < 0.02


def test_frames_that_come_too_fast_are_dropped_and_counted(
    shot: Shot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The clock jumps ahead: those frames are late, and every one of them is accounted for."""
    slam = real_time(shot)
    clock = iter([0.0] + [0.05 * k + (5.0 if 4 <= k < 8 else 0.0) for k in range(1, 10)])
    behind = slam._pace.behind
    monkeypatch.setattr(slam._pace, "behind", lambda timestamp: behind(timestamp, next(clock)))
    states = [slam.track(shot.images[k], 0.05 * k, shot.wheels[k]).status for k in range(10)]
    slam.finish()
    assert [s is Status.DROPPED for s in states] == [4 <= k < 8 for k in range(10)]
    assert slam.dropped == 4


def test_missing_frames_are_bridged_at_the_same_speed(shot: Shot) -> None:
    """As after dropped frames: by sight alone, every second frame is missing from the middle on."""
    slam, middle = Slam(shot.rig), 7
    states = [
        slam.track(shot.images[k], shot.drive.times[k])
        for k in [*range(middle), *range(middle + 1, FRAMES, 2)]
    ]
    assert all(state.status is Status.TRACKING for state in states[middle:])


def test_an_error_in_mapping_reaches_the_caller(shot: Shot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("facetcam.slam.threads.Pace.behind", lambda *_: False)  # the machine may be busy
    slam = real_time(shot)
    k = 0
    while shot.feed(slam, k) is not Status.TRACKING:
        k += 1

    def fail(*_: object) -> None:
        raise MemoryError("no room for a keyframe")

    monkeypatch.setattr(Mapper, "insert", fail)
    monkeypatch.setattr("facetcam.slam.tracking.localiser.is_due", lambda *_: True)
    with pytest.raises(MemoryError, match="no room"):
        for later in range(k + 1, FRAMES):
            shot.feed(slam, later)
        slam.finish()
    assert len(slam.trajectory()[0]) > 0  # what was found stays
    slam.close()
    assert background_threads() == 0


def test_many_callers_do_not_lock_each_other_out(shot: Shot) -> None:
    """Readers and a second feeder: each frame is taken once, late ones are refused in one line."""
    slam, refused = real_time(shot), []

    def feed() -> None:
        for k in range(FRAMES):
            try:
                shot.feed(slam, k)
            except FacetcamError as error:
                refused.append(str(error))

    def read() -> None:
        for _ in range(50):
            assert len(slam.trajectory()[0]) <= FRAMES
            assert len(slam.cloud()[0]) >= 0 and slam.keyframe_poses.shape[1:] == (4, 4)
            time.sleep(0.01)

    threads = [threading.Thread(target=job, daemon=True) for job in (feed, feed, read)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(SOON)
    assert not any(thread.is_alive() for thread in threads)
    slam.finish()
    assert refused and all("does not come after" in line for line in refused)
    assert slam.track(shot.images[0], 1e3).timestamp == 1e3
    slam.close()
    assert background_threads() == 0
