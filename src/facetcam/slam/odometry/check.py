"""Whether wheel odometry turns and goes as the film does: its clock, its units, its sign."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from facetcam.geometry import se3
from facetcam.slam.odometry.planar import planar_motion

Array = NDArray[np.float64]

CLOCK_RANGE = 2.0  # seconds by which the two clocks may differ

_LAGS = np.linspace(-CLOCK_RANGE, CLOCK_RANGE, 201)
_MIN_STEPS = 60
_EVERY = 20  # steps between two looks
_MIN_TURN = 1.0  # radians, in all
_ROUNDING = 0.01
_AGREES = 0.3  # residual over the turns themselves
_CLEARLY = 0.5  # a clock offset must at least halve the residual
_NEAR = 0.4  # seconds round the best lag where others may be as good
_DISTINCT = 1.3
_FRAME_SHARE = 0.4  # offsets below this share of the frame interval do no harm
_LIKENESS = 0.9  # correlation that shows two courses to be the same but for their unit
_TOLERABLE = 0.5
_TURNING = 0.01  # radians between two frames
_LEAST_SHARED = 0.5
_UNPROVEN = 20.0  # factor by which a map whose scale is a guess may differ
_STEP = 1e-3  # metres; what seems shorter is noise
_SAME_WAY = 0.5  # cosine
_RECENT = 20  # steps
_FEW = 5  # that prove nothing
_LIKE_LENGTH, _LIKE_WAY = 0.7, 0.9  # ratio, cosine of steps that wheels and images agree on
_UNLIKE_TURN = 2.0  # radians after which courses that differ belong to different drives


class OdometryCheck:
    """Compares turns of the wheels with turns seen, which need no scale, over a range of clock offsets.

    Ways are compared too: their direction, and their length, closely where the images prove the scale.

    Attributes
    ----------
    offset : float or None
        Seconds to add to a frame's time to find its row in the odometry; None while that is not known.
    complaint : str
        Why the odometry cannot be that of the film, for people; empty while nothing is known against it.
    """

    def __init__(self) -> None:
        self.offset: float | None = None
        self.complaint = ""
        self._last: tuple[float, Array] | None = None
        self._spans: list[tuple[float, float]] = []
        self._turns: list[float] = []
        self._rows: list[tuple[float, float]] = []
        self._lengths: list[float] = []  # of the wheels over those seen
        self._directions: list[float] = []  # cosines between the ways of both
        self._last_row: Array | None = None

    def offer(
        self, timestamp: float, T_world_rig: Array | None, odometry: Array | None, metric: bool = False
    ) -> None:
        """Take the next frame: its pose by the images, whether their scale is proven, and its odometry."""
        if self.offset is not None or self.complaint:
            return
        if odometry is not None:
            self._rows.append((timestamp, float(odometry[2])))
        if T_world_rig is not None and self._last is not None and odometry is not None:
            then, T_last = self._last
            self._spans.append((then, timestamp))
            T_step = se3.inverse(T_last) @ T_world_rig
            self._turns.append(float(se3.log(T_step)[2]))
            self._compare_ways(T_step[:3, 3], odometry)
            if len(self._turns) >= _MIN_STEPS and len(self._turns) % _EVERY == 0:
                self._judge_turns()
                if self.offset is None and not self.complaint:
                    self._judge_ways(metric)
        self._last = None if T_world_rig is None else (timestamp, T_world_rig.copy())
        self._last_row = odometry

    def conclude(self, metric: bool) -> None:
        """Judge the ways once more at the end, when the scale may be proven that was not before."""
        if not self.complaint:
            self._judge_ways(metric)

    @property
    def agrees(self) -> bool:
        """True while wheels and images went the same way lately: such wheels can be asked in the dark."""
        return len(self._lengths) >= _RECENT and self.foretells

    @property
    def foretells(self) -> bool:
        """True until wheels and images go different ways: such wheels foretell the next pose best."""
        if self.complaint:
            return False
        if len(self._lengths) < _FEW:
            return True
        length, cosine = (float(np.median(x[-_RECENT:])) for x in (self._lengths, self._directions))
        return _LIKE_LENGTH < length < 1.0 / _LIKE_LENGTH and cosine > _LIKE_WAY

    def _compare_ways(self, seen: Array, odometry: Array) -> None:
        if self._last_row is None:
            return
        way = planar_motion(self._last_row, odometry, 0.0)[0][:3, 3]
        length, seen_length = float(np.linalg.norm(way)), float(np.linalg.norm(seen))
        if length > 0.0 and seen_length > _STEP:
            self._lengths.append(length / seen_length)
            self._directions.append(float(way @ seen) / (length * seen_length))

    def _judge_ways(self, metric: bool) -> None:
        """Name a wrong unit or direction; the median of all steps knows neither slip nor jumps."""
        if len(self._lengths) < _MIN_STEPS:
            return
        factor, most = float(np.median(self._lengths)), 1.0 / _TOLERABLE if metric else _UNPROVEN
        if not 1.0 / most < factor < most:
            self.complaint = f"it goes {factor:.3g} times as far as the film; x and y are in metres"
        elif float(np.median(self._directions)) < _SAME_WAY:
            self.complaint = "it goes another way than the film; x is ahead, y to the left, at yaw 0"

    def _judge_turns(self) -> None:
        seen = np.array(self._turns)
        total = float(np.abs(seen).sum())
        if total < _MIN_TURN:
            return
        turned = self._wheel_turns()
        valid = np.isfinite(turned)
        enough = valid.sum(axis=1) >= 0.6 * len(seen)
        error = np.full(len(_LAGS), np.inf)
        for i in np.flatnonzero(enough):
            rows = valid[i]
            usual = max(float(np.abs(seen[rows]).mean()), 1e-9)
            error[i] = _ROUNDING + np.abs(seen - turned[i])[rows].mean() / usual
        best, now = int(np.argmin(error)), len(_LAGS) // 2
        if error[best] < _AGREES:
            self._judge_clock(error, best, now)
        else:
            self._judge_course(seen, turned, enough, total)

    def _wheel_turns(self) -> Array:
        """Turn of the wheels (L, N) over every span, for every lag; NaN where there are no rows."""
        times, yaw = np.array(self._rows).T
        yaw = np.unwrap(yaw)
        spans = np.array(self._spans)[None] + _LAGS[:, None, None]
        turns = np.diff(np.interp(spans, times, yaw), axis=2)[:, :, 0]
        outside = (spans[:, :, 0] < times[0]) | (spans[:, :, 1] > times[-1])
        return np.where(outside, np.nan, turns)

    def _judge_clock(self, error: Array, best: int, now: int) -> None:
        interval = float(np.median([b - a for a, b in self._spans]))
        far = np.abs(_LAGS - _LAGS[best]) > _NEAR
        distinct = error[far].min() > _DISTINCT * error[best]
        if not distinct:
            return  # a steady turn looks the same at any time
        shifted = abs(_LAGS[best]) > _FRAME_SHARE * interval and error[best] < _CLEARLY * error[now]
        if shifted:
            self.offset = float(_LAGS[best])

    def _judge_course(self, seen: Array, turned: Array, enough: NDArray[np.bool_], total: float) -> None:
        """Name the unit or the sign of a course that is alike but for a factor; refuse one that is not."""
        likeness, gain = np.zeros(len(_LAGS)), np.ones(len(_LAGS))
        for i in np.flatnonzero(enough):
            rows = np.isfinite(turned[i])
            a, b = seen[rows], turned[i][rows]
            likeness[i] = a @ b / max(float(np.linalg.norm(a) * np.linalg.norm(b)), 1e-12)
            gain[i] = a @ b / max(float(a @ a), 1e-12)
        best = int(np.argmax(np.abs(likeness)))
        if abs(likeness[best]) > _LIKENESS:
            self.complaint = _wrong_gain(float(gain[best]))
        elif total > _UNLIKE_TURN and _shared(seen, turned) < _LEAST_SHARED:
            self.complaint = "its turns are not those of the film; give the odometry of this drive"


def _shared(seen: Array, turned: Array) -> float:
    """Largest share of the turns, over all lags, that the wheels made too, since they may stand blocked."""
    turning = np.abs(seen) > _TURNING
    fits = np.abs(turned - seen) < _AGREES * np.abs(seen) + _TURNING
    return float((fits & turning).sum(axis=1).max() / max(turning.sum(), 1))


def _wrong_gain(gain: float) -> str:
    if _TOLERABLE < gain < 1.0 / _TOLERABLE:
        return ""  # wheels that skid in turns
    if gain < 0:
        return "it turns the other way than the film; yaw grows to the left, x is ahead, y to the left"
    unit = "; yaw is in radians" if 30 < gain < 90 else ""
    return f"it turns {gain:.2f} times as far as the film{unit}"
