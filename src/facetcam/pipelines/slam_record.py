"""What a SLAM run writes while it goes on: the live trajectory and the state of every frame."""

from __future__ import annotations

import time
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from facetcam.geometry import se3
from facetcam.io.frames import Frame
from facetcam.io.outputs import LineWriter
from facetcam.io.trajectories import TumWriter
from facetcam.pipelines.pictures import EvenSample
from facetcam.slam import State, Status, ViewHealth
from facetcam.viz.report import Picture

WAY = "trajectory.tum"
PICTURES = 4
POSE = ("tx", "ty", "tz", "qx", "qy", "qz", "qw")
TWIST = ("rx", "ry", "rz", "tx", "ty", "tz")
UPPER = np.triu_indices(6)
UNSEEN = ViewHealth(0, 0)


@dataclass(frozen=True, slots=True)
class FrameNote:
    """What the report needs of every frame: no more, since films are long."""

    timestamp: float
    status: Status
    predicted: tuple[int, ...]  # map points expected in each view
    inliers: tuple[int, ...]  # map points measured in each view

    @classmethod
    def of(cls, state: State, view_names: tuple[str, ...]) -> FrameNote:
        """Take it from a state."""
        health = [state.views.get(name, UNSEEN) for name in view_names]
        return cls(
            state.timestamp,
            state.status,
            tuple(view.predicted for view in health),
            tuple(view.inliers for view in health),
        )


class SlamRecord:
    """Everything that a run gathers frame by frame, on disk at once.

    Parameters
    ----------
    folder : Path
        An empty folder.
    view_names : tuple of str
    """

    def __init__(self, folder: Path, view_names: tuple[str, ...]) -> None:
        self.folder = folder
        self.view_names = view_names
        self.notes: list[FrameNote] = []
        self.offered = 0  # by the source, with those that it dropped
        self.pictures: EvenSample[Picture] = EvenSample(PICTURES)
        self._started = time.perf_counter()
        with ExitStack() as files:
            self._ways = {0: files.enter_context(TumWriter(folder / WAY))}
            self._table = files.enter_context(LineWriter(folder / "states.csv"))
            self._table.write(",".join(state_columns(view_names)))
            self._files = files.pop_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._files.close()

    @property
    def frames(self) -> int:
        """Number of frames added."""
        return len(self.notes)

    @property
    def seconds(self) -> float:
        """Time since the start of the run."""
        return time.perf_counter() - self._started

    def add(self, frame: Frame, state: State) -> None:
        """Write the live pose and state of a frame, and keep what the report needs."""
        self.notes.append(FrameNote.of(state, self.view_names))
        self.offered = frame.index + 1
        self._table.write(",".join(state_cells(state, self.view_names)))
        if state.T_world_rig is not None:
            self._way_in(state.map).append(state.timestamp, state.T_world_rig)
        caption = f"{state.timestamp:.1f} s, {len(state.pixels)} points measured"
        self.pictures.offer(lambda: Picture(caption, frame.image, state.pixels, state.pixel_views))

    def _way_in(self, map: int) -> TumWriter:
        """The file of live poses in one map: each has a world of its own."""
        if map not in self._ways:
            self._ways[map] = self._files.enter_context(TumWriter(self.folder / way_in(map)))
        return self._ways[map]


def way_in(map: int | str) -> str:
    """Name of the file of poses in a map that is not that of the path."""
    return f"trajectory_map{map}.tum"


def state_columns(view_names: tuple[str, ...]) -> list[str]:
    """Header of `states.csv`: the covariance is the upper triangle, rotation (rad) before translation (m)."""
    covariance = [f"cov_{TWIST[i]}_{TWIST[j]}" for i, j in zip(*UPPER)]
    health = [f"{name}_{kind}" for name in view_names for kind in ("predicted", "inliers")]
    scale = ["keyframe", "metric", "scale_sigma", "map_points", "map"]
    return ["timestamp", "status", *POSE, *covariance, *scale, *health]


def state_cells(state: State, view_names: tuple[str, ...]) -> list[str]:
    """One row of `states.csv`; cells without a value are empty."""
    pose, covariance = [""] * len(POSE), [""] * len(UPPER[0])
    if (T := state.T_world_rig) is not None:
        pose = [f"{value:.9f}" for value in (*T[:3, 3], *se3.to_quaternion_xyzw(T))]
    if state.covariance is not None:
        covariance = [f"{value:.6e}" for value in state.covariance[UPPER]]
    sigma = f"{state.scale_sigma:.6g}" if np.isfinite(state.scale_sigma) else ""
    scale = [str(int(state.keyframe)), str(int(state.metric)), sigma, str(state.map_points), str(state.map)]
    health = [state.views.get(name, UNSEEN) for name in view_names]
    counts = [str(count) for view in health for count in (view.predicted, view.inliers)]
    return [f"{state.timestamp:.9f}", state.status.value, *pose, *covariance, *scale, *counts]
