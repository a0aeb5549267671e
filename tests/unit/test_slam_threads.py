"""The fair lock, background jobs and the watch on the clock."""

from __future__ import annotations

import threading

import pytest

from facetcam.slam.threads import Background, FairLock, Pace

SOON = 10.0  # seconds that no wait here should ever take


def test_the_lock_goes_to_whoever_asked_first() -> None:
    """A thread that asks again at once gets in line behind the one that waits."""
    lock, order = FairLock(), []

    def wait_for_it() -> None:
        with lock:
            order.append("waiting")

    other = threading.Thread(target=wait_for_it)
    with lock:
        other.start()
        while not lock._waiting:
            pass
    with lock:
        order.append("again")
    other.join(SOON)
    assert order == ["waiting", "again"]


def test_only_one_thread_holds_the_lock() -> None:
    lock, count, most = FairLock(), [0], [0]

    def enter_often() -> None:
        for _ in range(200):
            with lock:
                count[0] += 1
                most[0] = max(most[0], count[0])
                count[0] -= 1

    threads = [threading.Thread(target=enter_often) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(SOON)
    assert most[0] == 1
    with lock:  # and nobody kept it
        pass


def test_an_error_under_the_lock_gives_it_back() -> None:
    lock = FairLock()
    with pytest.raises(KeyError), lock:
        raise KeyError
    with lock:
        pass


def test_without_a_thread_jobs_are_done_at_once() -> None:
    done: list[int] = []
    background = Background(threaded=False)
    background.run(lambda: done.append(threading.get_ident()))
    assert done == [threading.get_ident()]
    with pytest.raises(ZeroDivisionError):
        background.run(lambda: print(1 // 0))


def test_a_job_runs_beside_the_caller_and_is_waited_for() -> None:
    go, done = threading.Event(), []
    background = Background(threaded=True)

    def job() -> None:
        go.wait(SOON)
        done.append(threading.get_ident())

    background.run(job)
    assert background.busy and not done
    go.set()
    background.wait()
    assert not background.busy
    assert len(done) == 1 and done[0] != threading.get_ident()


def test_an_error_of_a_job_reaches_the_caller_once() -> None:
    background = Background(threaded=True)
    background.run(lambda: print(1 // 0))
    background.join()
    with pytest.raises(ZeroDivisionError):
        background.check()
    background.check()
    background.run(lambda: None)
    background.wait()


def test_steady_frames_are_never_behind_whatever_the_clocks_say() -> None:
    pace = Pace()
    assert not any(pace.behind(0.1 * k, 1e5 + 0.1 * k) for k in range(100))


def test_slow_tracking_falls_behind_and_catches_up() -> None:
    """Frames every 0.1 s that take 0.15 s each: one in three is dropped, and the lag stays small."""
    pace, now, dropped = Pace(), 0.0, []
    for k in range(60):
        now = max(now, 0.1 * k)
        dropped.append(pace.behind(0.1 * k, now))
        now += 0.0 if dropped[-1] else 0.15
        assert now - 0.1 * k < 0.4
    assert 0.25 < sum(dropped) / len(dropped) < 0.4


def test_a_camera_clock_that_drifts_is_not_taken_for_lag() -> None:
    pace = Pace()
    assert not any(pace.behind(0.1 * k, 0.1 * k * 1.0005) for k in range(20_000))
