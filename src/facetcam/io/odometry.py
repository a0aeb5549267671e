"""Wheel odometry: a table `timestamp,x,y,yaw`, or a topic of a ROS bag, in a drifting frame of its own."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from facetcam.errors import SourceError
from facetcam.io.outputs import atomic_write
from facetcam.io.ros_bag import Bag, wheel_odometry
from facetcam.io.tables import read_numbers, require_increasing

Array = NDArray[np.float64]
COLUMNS = "timestamp,x,y,yaw"
_WIDE = 60.0  # range of yaw that is little in degrees, but many turns in radians
_ALONG = (0.95, 0.8)  # shares of the way along a heading: of wheels that cannot go aside, and of a wrong one
FASTEST = 10.0  # metres or radians a second, that a robot keeps up
MAX_GAP = 0.5  # seconds; over longer ones a straight line would be invented motion


@dataclass(frozen=True, slots=True)
class Odometry:
    """Positions in metres and headings in radians at increasing times in seconds; `yaw` is unwrapped."""

    times: Array
    x: Array
    y: Array
    yaw: Array

    def at(self, time: float) -> tuple[float, float, float] | None:
        """Return x, y, yaw between the two nearest rows, or None outside the table and in its gaps."""
        after = int(np.searchsorted(self.times, time))
        if after == len(self.times) or (after == 0 and time < self.times[0]):
            return None
        if self.times[after] - self.times[max(after - 1, 0)] > MAX_GAP and time < self.times[after]:
            return None
        x, y, yaw = (float(np.interp(time, self.times, column)) for column in (self.x, self.y, self.yaw))
        return x, y, yaw

    def shifted(self, offset: float) -> Odometry:
        """The same rows on a clock by which those of a time are found `offset` seconds earlier."""
        return replace(self, times=self.times - offset)

    def require_cover(self, span: tuple[float, float], what: str, slack: float) -> None:
        """Raise SourceError unless the table reaches over `span` (first, last) but for `slack` seconds."""
        first, last = self.times[0], self.times[-1]
        if first > span[0] + slack or last < span[1] - slack:
            raise SourceError(
                f"odometry: covers {first:.3f} to {last:.3f} s, but {what} runs from {span[0]:.3f} to"
                f" {span[1]:.3f} s; give odometry on the film's clock"
            )


def write_odometry(path: Path, times: Array, rows: Array) -> None:
    """Write rows x, y, yaw (N, 3) at times (N,).

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    lines = [f"{t:.6f},{x:.6f},{y:.6f},{yaw:.6f}" for t, (x, y, yaw) in zip(times, rows, strict=True)]
    atomic_write(path, "\n".join([COLUMNS, *lines]) + "\n")


def read_odometry(path: Path | str) -> Odometry:
    """Read an odometry table, or the odometry of a ROS bag (`BAG` or `BAG:/TOPIC`).

    Raises
    ------
    SourceError
        If the file cannot be read, is empty, has another header, a line is wrong or not later than the one
        before, or its usual speeds show other units.
    """
    bag = Bag.at(path)
    table = read_numbers(Path(path), COLUMNS, header=True) if bag is None else wheel_odometry(bag)
    times, x, y, yaw = table.T.copy()
    if bag is not None:
        require_increasing(times, str(path))
    _require_plausible(path, times, x, y, yaw)
    return Odometry(times, x, y, np.unwrap(yaw))


def _require_plausible(path: Path | str, times: Array, x: Array, y: Array, yaw: Array) -> None:
    """Refuse tables in other units: their usual speed, interval, or heading is that of no robot."""
    if len(times) < 2:
        return
    interval = float(np.median(np.diff(times)))
    if interval > MAX_GAP:
        raise SourceError(
            f"{path}: rows usually come {interval:.3g} s apart, and {MAX_GAP} s is a gap; give more rows, in"
            " seconds"
        )
    in_degrees, in_radians = _ahead(x, y, np.radians(yaw)), _ahead(x, y, yaw)
    if np.ptp(yaw) > _WIDE and in_degrees > _ALONG[0] and in_radians < _ALONG[1]:
        raise SourceError(f"{path}: it drives along its yaw if that is in degrees; give radians")
    turns = np.abs(np.arctan2(np.sin(np.diff(yaw)), np.cos(np.diff(yaw))))
    for name, steps, unit in (("x, y", np.hypot(np.diff(x), np.diff(y)), "m"), ("yaw", turns, "rad")):
        moving = steps > 1e-9
        speed = float(np.median((steps / np.diff(times))[moving])) if moving.any() else 0.0
        if speed > FASTEST:
            raise SourceError(
                f"{path}: {name} usually change by {speed:.0f} {unit}/s; give seconds, metres and radians"
            )


def _ahead(x: Array, y: Array, yaw: Array) -> float:
    """Share of the way that leads along the heading, forwards or backwards."""
    dx, dy, middle = np.diff(x), np.diff(y), 0.5 * (yaw[1:] + yaw[:-1])
    way = float(np.hypot(dx, dy).sum())
    return float(np.abs(dx * np.cos(middle) + dy * np.sin(middle)).sum()) / max(way, 1e-12)
