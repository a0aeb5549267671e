"""What real time needs: a fair lock, work in the background, a watch on the clock; one thread for sums."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from functools import wraps
from types import TracebackType
from typing import ParamSpec, TypeVar

from threadpoolctl import threadpool_limits

P = ParamSpec("P")
R = TypeVar("R")

_MAX_LAG = 0.1  # seconds behind the frames, at least three of them at 30 a second
_DRIFT = 1e-3  # seconds a second by which the camera's clock may run off ours


class FairLock:
    """A lock that goes to whoever asked first, so that a busy thread cannot keep it by asking again."""

    def __init__(self) -> None:
        self._mutex = threading.Lock()
        self._waiting: deque[threading.Lock] = deque()
        self._held = False

    def __enter__(self) -> None:
        with self._mutex:
            if not self._held:
                self._held = True
                return
            turn = threading.Lock()
            turn.acquire()
            self._waiting.append(turn)
        try:
            turn.acquire()
        except BaseException:  # interrupted while waiting
            with self._mutex:
                ours = turn not in self._waiting
                if not ours:
                    self._waiting.remove(turn)
            if ours:
                self._pass_on()
            raise

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._pass_on()

    def _pass_on(self) -> None:
        with self._mutex:
            if self._waiting:
                self._waiting.popleft().release()
            else:
                self._held = False


class Background:
    """Runs one job at a time: in a thread of its own, or at once where results must not depend on time.

    Parameters
    ----------
    threaded : bool
    """

    def __init__(self, threaded: bool) -> None:
        self._threaded = threaded
        self._thread: threading.Thread | None = None
        self._error: BaseException | None = None

    @property
    def busy(self) -> bool:
        """True while a job runs."""
        return self._thread is not None and self._thread.is_alive()

    def run(self, job: Callable[[], None]) -> None:
        """Start a job after the one before; an error of that one is raised here."""
        self.wait()
        if not self._threaded:
            job()
            return
        self._thread = threading.Thread(target=self._attempt, args=(job,), name="facetcam-background")
        self._thread.start()

    def check(self) -> None:
        """Raise the error of a job that failed."""
        if self._error is not None and not self.busy:
            error, self._error = self._error, None
            raise error

    def wait(self) -> None:
        """Wait for the job to end, and raise its error."""
        self.join()
        self.check()

    def join(self) -> None:
        """Wait for the job to end, however it does."""
        if self._thread is not None:
            self._thread.join()

    def _attempt(self, job: Callable[[], None]) -> None:
        try:
            job()
        except BaseException as error:  # it belongs to the caller, whatever it is
            self._error = error


class Pace:
    """Tells how far tracking has fallen behind the frames.

    The least time seen from a frame's timestamp to its arrival counts as none, so that the clocks need not
    agree.
    """

    def __init__(self) -> None:
        self._least: float | None = None
        self._timestamp = 0.0

    def behind(self, timestamp: float, now: float | None = None) -> bool:
        """True where a frame comes so late that it must be dropped to catch up."""
        late = (time.perf_counter() if now is None else now) - timestamp
        if self._least is None:
            self._least, self._timestamp = late, timestamp
        self._least = min(late, self._least + _DRIFT * (timestamp - self._timestamp))
        self._timestamp = timestamp
        return late - self._least > _MAX_LAG


def on_one_thread(function: Callable[P, R]) -> Callable[P, R]:
    """Let linear algebra in a function keep to one thread: with more its sums differ in the last bits."""

    @wraps(function)
    def limited(*args: P.args, **kwargs: P.kwargs) -> R:
        with threadpool_limits(1, "blas"):
            return function(*args, **kwargs)

    return limited
