"""Trajectories as TUM text files: `timestamp tx ty tz qx qy qz qw`, one pose a line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from facetcam.errors import FacetcamError, SourceError
from facetcam.geometry import se3
from facetcam.io.outputs import LineWriter, atomic_write
from facetcam.io.tables import read_numbers

Array = NDArray[np.float64]
COLUMNS = "timestamp tx ty tz qx qy qz qw"
HEADER = f"# {COLUMNS}"
UNIT_TOLERANCE = 0.01  # a quaternion further from length 1 is taken for a wrong column, not for rounding


def read_tum(path: Path | str) -> tuple[Array, Array]:
    """Read a trajectory.

    Returns
    -------
    times : (N,) array
        Seconds, increasing.
    poses : (N, 4, 4) array
        T_world_body.

    Raises
    ------
    SourceError
        If the file cannot be read, is empty, or a line is no pose later than the one before.
    """
    table = read_numbers(Path(path), COLUMNS)
    lengths = np.linalg.norm(table[:, 4:], axis=1)
    wrong = np.flatnonzero(np.abs(lengths - 1.0) > UNIT_TOLERANCE)
    if len(wrong):
        raise SourceError(
            f"{path}: the quaternion at {table[wrong[0], 0]:.6f} s has length {lengths[wrong[0]]:.3g}, not 1;"
            f" expected columns {COLUMNS}"
        )
    poses = np.array([se3.from_quaternion_xyzw(row[4:], row[1:4]) for row in table])
    return table[:, 0].copy(), poses


def write_tum(path: Path | str, times: Array, poses: Array) -> None:
    """Write a whole trajectory, replacing the file in one step.

    Raises
    ------
    OutputError
        If it cannot be written.
    FacetcamError
        If a pose is not a finite rigid motion.
    """
    lines = [HEADER, *(tum_line(time, pose) for time, pose in zip(times, poses, strict=True))]
    atomic_write(Path(path), "\n".join(lines) + "\n")


class TumWriter(LineWriter):
    """A trajectory that grows line by line while a run goes on."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.write(HEADER)

    def append(self, time: float, pose: Array) -> None:
        """Add the pose (4, 4) at `time` seconds."""
        self.write(tum_line(time, pose))


def tum_line(time: float, pose: Array) -> str:
    """One line of a TUM file, 9 decimals."""
    if not np.isfinite(time) or not np.all(np.isfinite(pose)):
        raise FacetcamError(f"pose at {time} s: not finite")
    values = [*pose[:3, 3], *se3.to_quaternion_xyzw(pose)]
    return f"{time:.9f} " + " ".join(f"{value:.9f}" for value in values)
