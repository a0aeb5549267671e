"""`facetcam slam` on films of other rigs, rough floors and poor light, rendered once into a cache folder.

Every film is tracked by sight alone and with wheels. *3 sigma* is the share of live poses whose error lies
within the 99.7 % of its covariance, *NEES* their median squared error in sigmas (5.3 where the covariance is
exact).
"""

from __future__ import annotations

import argparse
import csv
import json
import shutil
from dataclasses import dataclass
from pathlib import Path
from subprocess import run as call
from typing import Any

import numpy as np
from _common import data_folder, show
from _rig_films import ELSEWHERE, FILMS, UNSEEN, Film, render
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.stats import chi2
from slam import MAX_GAP, Run, live_error, scale

from facetcam.evaluation.trajectory import associate
from facetcam.geometry import se3
from facetcam.io.trajectories import read_tum
from facetcam.slam.map.file import read_map

Array = NDArray[np.float64]

COLUMNS = (
    "film",
    "tracked",
    "ATE cm",
    "scaled cm",
    "live cm",
    "scale",
    "scale error",
    "in sigmas",
    "3 sigma",
    "NEES",
)
_UPPER = np.triu_indices(6)


@dataclass(frozen=True)
class Honesty:
    """How the errors of live poses compare with their covariances."""

    within: float
    median: float


def honesty(states: Path, map: Path, number: int, truth: Path) -> Honesty:
    """Judge the live poses in the map of that number against its first keyframe, as covariances are told."""
    with states.open() as file:
        rows = [r for r in csv.DictReader(file) if r["tx"] and r["cov_tz_tz"] and int(r["map"]) == number]
    poses = np.stack([_pose(r) for r in rows])
    times, true = read_tum(truth)
    own, ones = associate(np.array([float(r["timestamp"]) for r in rows]), times, MAX_GAP)
    arrays = read_map(map)[1]
    base = se3.inverse(true[int(np.argmin(np.abs(times - arrays["keyframes.timestamp"][0])))])
    began = se3.inverse(arrays["keyframes.T_world_rig"][0])
    nees = []
    for i, j in zip(own, ones):
        error = se3.log(se3.inverse(base @ true[j]) @ began @ poses[i])
        nees.append(float(error @ np.linalg.solve(_covariance(rows[i]), error)))
    return Honesty(float(np.mean(np.array(nees) < chi2.ppf(0.9973, 6))), float(np.median(nees)))


def _pose(row: dict[str, str]) -> Array:
    line = np.array([float(row[k]) for k in ("tx", "ty", "tz", "qx", "qy", "qz", "qw")])
    return se3.from_rotation_translation(Rotation.from_quat(line[3:]).as_matrix(), line[:3])


def _covariance(row: dict[str, str]) -> Array:
    full = np.zeros((6, 6))
    full[_UPPER] = [float(value) for key, value in row.items() if key.startswith("cov_")]
    return full + np.triu(full, 1).T


def measure(film: Film, cache: Path, rig: str, wheels: bool) -> list[str]:
    """One row of the table; a run that fails says its own line there."""
    name = f"{film.name}{' + wheels' if wheels else ''}"
    files = {key: f"{film.slug}/{file}" for key, file in (("source", "film.mp4"), ("truth", "truth.tum"))}
    odometry = f"{film.slug}/odometry.csv" if wheels else ""
    out = cache / "runs" / f"{film.slug}{'-wheels' if wheels else ''}"
    shutil.rmtree(out, ignore_errors=True)
    command = Run(name, rig=f"{film.slug}/{rig}", odometry=odometry, **files).command(cache, out)
    done = call(command, capture_output=True, text=True)
    if done.returncode:
        print(f"{name}: {done.stderr.strip().splitlines()[-1]}")
        return [name, "0 %"]
    summary = json.loads((out / "summary.json").read_text())
    for warning in summary["warnings"]:
        print(f"{name}: {warning}")
    return [name, *figures(summary, out, cache / files["truth"])]


def figures(summary: dict[str, Any], out: Path, truth: Path) -> list[str]:
    """What a run tells against the truth."""
    errors, sigma = summary["errors"], summary["scale_sigma"]
    tracked = f"{100 * summary['tracked'] / summary['frames']:.0f} %"
    if not errors:
        return [tracked, "no path"]
    judged = honesty(out / "states.csv", out / "map.facetmap", summary["map"], truth)
    return [
        tracked,
        f"{100 * errors['ate']['rmse']:.1f}",
        f"{100 * errors['ate_scaled']['rmse']:.1f}",
        f"{100 * live_error(out / 'states.csv', summary['map'], truth):.1f}",
        scale(summary),
        f"{100 * errors['scale_error']:+.2f} %",
        "" if sigma is None else f"{abs(errors['scale_error']) / sigma:.1f}",
        f"{100 * judged.within:.0f} %",
        f"{judged.median:.1f}",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cache", type=Path, default=Path("rig_films"), help="folder of films and runs")
    parser.add_argument("--only", default="", help="only films whose name holds this")
    parser.add_argument("--elsewhere", action="store_true", help="the second set: the rigs in other rooms")
    parser.add_argument("--unseen", action="store_true", help="the third set, by which nothing was tuned")
    parser.add_argument("--rig", default="rig_true.yaml", help="or rig_nominal.yaml, the rig as drawn")
    options = parser.parse_args()
    scene, rows = data_folder() / "house" / "small_house.glb", []
    films = UNSEEN if options.unseen else ELSEWHERE if options.elsewhere else FILMS
    for film in (f for f in films if options.only in f.name):
        render(film, scene, options.cache)
        for wheels in (False, True):
            rows.append(measure(film, options.cache, options.rig, wheels))
            print(*rows[-1], sep=" | ", flush=True)
    show(f"films of other rigs, {options.rig}", COLUMNS, rows)


if __name__ == "__main__":
    main()
