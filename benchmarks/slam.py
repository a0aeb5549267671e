"""Error, speed and memory of `facetcam slam` on the films with truth, each run a process of its own."""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from _common import data_folder, show

COLUMNS = ("film", "frames", "tracked", "ATE cm", "ATE scaled cm", "scale", "frames/s", "peak MB")


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
        return row(run.name, json.loads((out / "summary.json").read_text()))


def row(name: str, summary: dict[str, Any]) -> list[str]:
    errors, sigma = summary["errors"], summary["scale_sigma"]
    known = "" if sigma is None else f" ± {100 * sigma:.2g} %"
    return [
        name,
        str(summary["frames"]),
        f"{100 * summary['tracked'] / summary['frames']:.1f} %",
        f"{100 * errors['ate']['rmse']:.1f}" if errors else "no path",
        f"{100 * errors['ate_scaled']['rmse']:.1f}" if errors else "",
        ("METRIC" if summary["metric"] else "NOT METRIC") + known,
        f"{summary['frames_per_second']:.1f}",
        f"{summary['peak_memory_mb']:.0f}",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="run only films whose name holds this")
    only: str = parser.parse_args().only
    data = data_folder()
    show("facetcam slam", COLUMNS, [measure(run, data) for run in RUNS if only in run.name])


if __name__ == "__main__":
    main()
