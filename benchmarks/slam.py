"""Error, speed and memory of `facetcam slam` on the films with truth, each run a process of its own.

*live* is the error of the poses as they were given while the film ran (`states.csv`); the others are those of
the final ones.
"""

from __future__ import annotations

import argparse
import csv
import json
import subprocess
import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from _common import data_folder, show

from facetcam.evaluation.trajectory import associate, ate
from facetcam.io.trajectories import read_tum

COLUMNS = ("film", "frames", "tracked", "ATE cm", "scaled cm", "live cm", "scale", "frames/s", "peak MB")
MAX_GAP = 0.02  # seconds between a pose and its truth


@dataclass(frozen=True)
class Run:
    """One film with its options; paths are relative to the data folder."""

    name: str
    source: str
    rig: str
    truth: str
    odometry: str = ""

    def command(self, data: Path, out: Path) -> list[str]:
        facetcam = Path(sys.executable).with_name("facetcam")
        words = [facetcam, "slam", data / self.source, "--rig", data / self.rig, "--out", out]
        words += ["--truth", data / self.truth]
        return [str(word) for word in words + (["--odometry", data / self.odometry] if self.odometry else [])]


HOUSE = "house/rig_true.yaml"
RUNS = (
    Run("loop + odometry", "house/loop.mp4", HOUSE, "house/loop.tum", "house/loop_odometry.csv"),
    Run("loop", "house/loop.mp4", HOUSE, "house/loop.tum"),
    Run("lights + odometry", "house/lights.mp4", HOUSE, "house/lights.tum", "house/lights_odometry.csv"),
    Run("lights", "house/lights.mp4", HOUSE, "house/lights.tum"),
    Run("kitchen", "kitchen", "kitchen/rig.yaml", "kitchen/truth.tum"),
)


def measure(run: Run, data: Path) -> list[str]:
    """One row of the table; a run that fails says its own line there."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        done = subprocess.run(run.command(data, out), capture_output=True, text=True)
        if done.returncode:
            return [run.name, "", done.stderr.strip().splitlines()[-1]]
        summary = json.loads((out / "summary.json").read_text())
        live = live_error(out / "states.csv", summary["map"], data / run.truth)
        return row(run.name, summary, live)


def live_error(states: Path, number: int, truth: Path) -> float:
    """ATE in metres of all poses of a table of states in the map of that number, at the scale they had."""
    with states.open() as file:
        rows = [r for r in csv.DictReader(file) if r["tx"] and int(r["map"]) == number]
    times = np.array([float(r["timestamp"]) for r in rows])
    positions = np.array([[float(r[axis]) for axis in ("tx", "ty", "tz")] for r in rows])
    true_times, poses = read_tum(truth)
    own, true = associate(times, true_times, MAX_GAP)
    return ate(positions[own], poses[true, :3, 3], with_scale=False).rmse


def scale(summary: dict[str, Any]) -> str:
    """What a run says of its scale."""
    sigma = summary["scale_sigma"]
    known = "" if sigma is None else f" ± {100 * sigma:.2g} %"
    return ("METRIC" if summary["metric"] else "NOT METRIC") + known


def row(name: str, summary: dict[str, Any], live: float) -> list[str]:
    errors = summary["errors"]
    return [
        name,
        str(summary["frames"]),
        f"{100 * summary['tracked'] / summary['frames']:.1f} %",
        f"{100 * errors['ate']['rmse']:.1f}" if errors else "no path",
        f"{100 * errors['ate_scaled']['rmse']:.1f}" if errors else "",
        f"{100 * live:.1f}",
        scale(summary),
        f"{summary['frames_per_second']:.1f}",
        f"{summary['peak_memory_mb']:.0f}",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="run only films whose name holds this")
    parser.add_argument("--rig", type=Path, help="rig of the house films in place of the true one")
    options = parser.parse_args()
    data, runs = data_folder(), [run for run in RUNS if options.only in run.name]
    if options.rig is not None:
        runs = [replace(run, rig=str(options.rig.resolve())) for run in runs if run.rig == HOUSE]
    show("facetcam slam", COLUMNS, [measure(run, data) for run in runs])


if __name__ == "__main__":
    main()
