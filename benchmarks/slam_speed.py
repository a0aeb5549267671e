"""Speed and memory of tracking and mapping: time a frame, and whether it stays flat while a film runs on."""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from _common import data_folder, show
from numpy.typing import NDArray

from facetcam.pipelines.inputs import SlamInputs, read_slam_inputs
from facetcam.pipelines.slam import when_due
from facetcam.slam import Slam, SlamConfig, Status

FILM, RIG = "house/loop.mp4", "house/rig_true.yaml"
TRUTH, WHEELS = "house/loop.tum", "house/loop_odometry.csv"
COLUMNS = (
    "frames",
    "threads",
    "median",
    "mean",
    "CPU",
    "CPU at the end",
    "frames/s",
    "tracked",
    "dropped",
    "MB",
)
IN_MEMORY = 200  # frames: colour takes 6 MB each
JPEG_QUALITY = 95
STEP = 0.1  # seconds between two frames


@dataclass(frozen=True, slots=True)
class Shot:
    """One frame for the tracker."""

    image: NDArray[np.generic]
    timestamp: float
    odometry: tuple[float, float, float] | None


@dataclass(frozen=True, slots=True)
class Case:
    """How the film is fed."""

    name: str
    kind: str
    threads: int
    real_time: bool = False


CASES = (
    Case("in memory", "memory", 1),
    Case("in memory", "memory", 2),
    Case("in memory, real time", "memory", 2, real_time=True),
    Case("decoding", "film", 1),
    Case("decoding", "film", 2),
    Case("decoding, real time", "film", 2, real_time=True),
    Case("over and over", "loop", 2),
)


def shots(inputs: SlamInputs) -> Iterator[Shot]:
    """The film as it comes."""
    for frame in inputs.source:
        yield Shot(frame.image, frame.timestamp, inputs.odometry_at(frame.timestamp))


def over_and_over(inputs: SlamInputs, times: int, folder: Path) -> Iterator[Shot]:
    """The film again and again: its last frame is its first one, so the motion is continuous.

    Frames wait on disk as grey pictures: what they take does not count as the tracker's memory.
    """
    kept, wheels = [], []
    for i, frame in enumerate(inputs.source):
        path = str(folder / f"{i:06d}.jpg")
        grey = cv2.cvtColor(frame.image, cv2.COLOR_BGR2GRAY)
        cv2.imwrite(path, grey, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
        kept.append(path)
        wheels.append(planar(inputs.odometry_at(frame.timestamp)))
    for k in range(times * (len(kept) - 1)):
        lap, i = divmod(k, len(kept) - 1)
        T = np.linalg.matrix_power(wheels[-1] @ np.linalg.inv(wheels[0]), lap) @ wheels[i]
        row = (float(T[0, 2]), float(T[1, 2]), float(np.arctan2(T[1, 0], T[0, 0])))
        yield Shot(cv2.imread(kept[i], cv2.IMREAD_GRAYSCALE), STEP * k, row)


def planar(row: tuple[float, float, float] | None) -> NDArray[np.float64]:
    """Motion (3, 3) of the plane by x, y, yaw."""
    x, y, yaw = row or (0.0, 0.0, 0.0)
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, -s, x], [s, c, y], [0.0, 0.0, 1.0]])


def run(case: Case, times: int) -> dict[str, float]:
    """One case in this process."""
    cv2.setNumThreads(case.threads)
    data = data_folder()
    inputs = read_slam_inputs(data / FILM, data / RIG, data / WHEELS, data / TRUTH, None, None, None)
    slam = Slam(inputs.rig, SlamConfig(real_time=case.real_time))
    with inputs.source, tempfile.TemporaryDirectory() as folder:
        if case.kind == "loop":
            source = over_and_over(inputs, times, Path(folder))
        else:
            source = shots(inputs)
            if case.kind == "memory":
                source = iter([shot for shot, _ in zip(source, range(IN_MEMORY))])
        return measure(slam, when_due(source) if case.real_time else source)


def measure(slam: Slam, source: Iterable[Shot]) -> dict[str, float]:
    walls, work, tracked = [], [], 0
    start = time.perf_counter()
    for shot in source:
        before, cpu = time.perf_counter(), time.process_time()
        state = slam.track(shot.image, shot.timestamp, shot.odometry)
        walls.append(1e3 * (time.perf_counter() - before))
        work.append(1e3 * (time.process_time() - cpu))
        tracked += state.status is Status.TRACKING
    seconds = time.perf_counter() - start
    slam.finish()
    tenth = max(len(walls) // 10, 1)
    return {
        "median": float(np.median(walls)),
        "mean": float(np.mean(walls)),
        "cpu": float(np.mean(work)),
        "fps": len(walls) / seconds,
        "tracked": 100 * tracked / len(walls),
        "dropped": slam.dropped,
        "last": float(np.mean(work[-tenth:])),
        "peak": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6,
    }


def row(case: Case, r: dict[str, float]) -> list[str]:
    return [
        case.name,
        str(case.threads),
        f"{r['median']:.1f}",
        f"{r['mean']:.1f}",
        f"{r['cpu']:.1f}",
        f"{r['last']:.1f}",
        f"{r['fps']:.1f}",
        f"{r['tracked']:.1f} %",
        f"{r['dropped']:.0f}",
        f"{r['peak']:.0f}",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="run only cases whose name holds this")
    parser.add_argument("--times", type=int, default=20, help="laps of `over and over`")
    parser.add_argument("--case", type=int, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.case is not None:
        print(json.dumps(run(CASES[args.case], args.times)))
        return
    rows = []
    for i, case in enumerate(CASES):
        if args.only in case.name:
            command = [sys.executable, __file__, "--case", str(i), "--times", str(args.times)]
            done = subprocess.run(command, capture_output=True, text=True)
            last = (done.stdout if done.returncode == 0 else done.stderr).strip().splitlines()[-1]
            rows.append(row(case, json.loads(last)) if done.returncode == 0 else [case.name, last])
    show("tracking and mapping, ms a frame", COLUMNS, rows)


if __name__ == "__main__":
    main()
