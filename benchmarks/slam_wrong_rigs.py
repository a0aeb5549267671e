"""`facetcam slam` on the loop of the house with rig files that are wrong by a known amount.

*drawn* is what the run says of the scale for a rig that was built with care after a drawing: it should cover
what is off where a file is wrong by little, and a rig that is wrong by much should be refused or denied.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from _common import data_folder, show
from slam import HOUSE, Run, scale

from facetcam.rig import Rig
from facetcam.rig.freedom import moved, tolerance

COLUMNS = ("rig file", "wheels", "tracked", "ATE cm", "scaled cm", "scale", "off", "drawn", "says")
_FILM = Run("", "house/loop.mp4", "", "house/loop.tum")
_WHEELS = "house/loop_odometry.csv"


def wrong_rigs(true: Rig) -> Iterator[tuple[str, Rig]]:
    """The true rig, and such as a drawing or a careless calibration may give."""
    yield "true", true
    for per_cent in (-3.0, -1.0, 1.0, 3.0):
        factor, camera = 1.0 + per_cent / 100.0, true.camera
        lens = replace(camera, fx=factor * camera.fx, fy=factor * camera.fy)
        yield f"focal length {per_cent:+.0f} %", replace(true, camera=lens)
    yield "left mirror 5 mm off", _with(true, "left: shift", 0.005)
    yield "left mirror turned by 0.5 degrees", _with(true, "left: tilt u", math.radians(0.5))
    yield "no distortion", replace(true, camera=replace(true.camera, distortion=(0.0,) * 5))


def _with(rig: Rig, number: str, off: float) -> Rig:
    known = tolerance(rig)
    step = np.zeros(len(known.parameters))
    step[known.parameters.index(number)] = off
    return replace(moved(rig, known, step), covariance=None)


def measure(name: str, rig: Path, data: Path, wheels: bool, more: list[str]) -> list[str]:
    """One row of the table; a run that fails says its own line there."""
    run, used = replace(_FILM, rig=str(rig), odometry=_WHEELS if wheels else ""), "yes" if wheels else "no"
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        done = subprocess.run(run.command(data, out) + more, capture_output=True, text=True)
        if done.returncode:
            return [name, used, *[""] * 6, done.stderr.strip().splitlines()[-1][:50]]
        summary = json.loads((out / "summary.json").read_text())
    errors, drawn = summary["errors"], summary["drawn_scale_sigma"]
    denied = any("another rig" in warning for warning in summary["warnings"])
    return [
        name,
        used,
        f"{100 * summary['tracked'] / summary['frames']:.0f} %",
        f"{100 * errors['ate']['rmse']:.1f}",
        f"{100 * errors['ate_scaled']['rmse']:.1f}",
        scale(summary),
        f"{100 * errors['scale_error']:+.2f} %",
        "" if drawn is None else f"± {100 * drawn:.2g} %",
        "another rig" if denied else "",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--refine-rig", action="store_true", help="let the rig's numbers move at the end")
    more = ["--refine-rig"] if parser.parse_args().refine_rig else []
    data, rows = data_folder(), []
    with tempfile.TemporaryDirectory() as folder:
        for number, (name, rig) in enumerate(wrong_rigs(Rig.load(data / HOUSE))):
            file = Path(folder) / f"rig_{number}.yaml"
            rig.save(file)
            for wheels in (False, True):
                rows.append(measure(name, file, data, wheels, more))
                print(*rows[-1], sep=" | ", flush=True)
    show(" ".join(["loop.mp4 with wrong rig files", *more]), COLUMNS, rows)


if __name__ == "__main__":
    main()
