"""A stand-in for `Slam` that tracks nothing: for tests of what surrounds it.

Run as a program, it is the `facetcam` command with that stand-in, a frame every 20 ms.
"""

from __future__ import annotations

import importlib
import time
from pathlib import Path
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

import facetcam.pipelines.slam
from facetcam.io.colmap_model import RigFrame
from facetcam.slam import State, Status, ViewHealth

Array = NDArray[np.float64]


class FakeSlam:
    """Says that the rig moves along x at 1 m/s; the first two frames are only placed at the end."""

    SECONDS_A_FRAME = 0.0
    metric = False
    dropped = 0
    scale_sigma = np.inf
    rig_refinement = drawn_scale_sigma = None
    nuisances = np.zeros(3)
    rig_check = SimpleNamespace(complaint="", remark="", moves_as_one=True, fits=True)
    grown = False
    loops = 0
    map_number = 0
    apart: ClassVar[dict[int, tuple[Array, Array]]] = {}
    next_map_from = 1 << 30  # frame
    odometry_check = SimpleNamespace(complaint="", offset=None)

    def __init__(self, rig: object, config: object) -> None:
        self.rig = self.rig_as_seen = rig
        self.seen: list[float] = []
        self.odometry: list[tuple[float, float, float] | None] = []
        self.timing = {"track": [0.01]}
        importlib.import_module("pycolmap")  # as the real one does: its logging takes SIGTERM for itself

    def pose(self, time_: float) -> Array:
        T = np.eye(4)
        T[0, 3] = time_
        return T

    def track(
        self, image: NDArray[np.generic], timestamp: float, odometry: tuple[float, float, float] | None
    ) -> State:
        time.sleep(self.SECONDS_A_FRAME)
        self.seen.append(timestamp)
        self.odometry.append(odometry)
        if len(self.seen) <= 2:
            return State(timestamp, Status.STARTING)
        pixels, views = np.array([[3.0, 4.0]], np.float32), np.zeros(1, np.int8)
        return State(
            timestamp,
            Status.TRACKING,
            self.pose(timestamp),
            np.eye(6) * 1e-4,
            {"front": ViewHealth(5, 1)},
            map_points=2,
            map=int(len(self.seen) > self.next_map_from),
            pixels=pixels,
            pixel_views=views,
        )

    def settle(self) -> None:
        """There is one map."""

    def finish(self) -> None:
        """Nothing is left to adjust."""

    def close(self) -> None:
        """No thread is left to wait for."""

    def trajectory(self) -> tuple[Array, Array]:
        return np.array(self.seen), np.array([self.pose(t) for t in self.seen]).reshape(-1, 4, 4)

    def trajectories_apart(self) -> dict[int, tuple[Array, Array]]:
        return self.apart

    def save_map(self, path: Path, number: int) -> None:
        path.write_text(str(number))

    def cloud(self) -> tuple[Array, NDArray[np.uint8]]:
        return np.zeros((2, 3)), np.full((2, 3), 255, np.uint8)

    def rig_frames(self) -> list[RigFrame]:
        return []

    @property
    def keyframe_poses(self) -> Array:
        return np.eye(4)[None]


if __name__ == "__main__":
    from facetcam.cli import main

    FakeSlam.SECONDS_A_FRAME = 0.02
    facetcam.pipelines.slam.Slam = FakeSlam
    main()
