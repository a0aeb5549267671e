"""A finished run, or one that still goes on, as a page in the browser."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np

from facetcam.errors import SourceError
from facetcam.evaluation.trajectory import associate
from facetcam.io.ply import read_ply
from facetcam.io.trajectories import read_tum
from facetcam.viz.run_page import Moment, RunPage, ShownRun

_WITHIN = 1e-6  # seconds between a state and its final pose


def open_run_page(folder: Path | str, port: int = 8080) -> RunPage:
    """Open the page of a run.

    Raises
    ------
    FacetcamError
        If the folder holds no run, a file of it is damaged, or viser is not installed.
    """
    return RunPage(read_run(Path(folder)), port)


def read_run(folder: Path) -> ShownRun:
    """Read what the page shows; a run that was cut short has no map and no summary yet."""
    if not (folder / "states.csv").is_file():
        raise SourceError(f"{folder}: no run; give a folder that `facetcam slam` wrote")
    moments = read_moments(folder)
    cloud = folder / "map.ply"
    points, colours = read_ply(cloud) if cloud.is_file() else (np.empty((0, 3)), np.empty((0, 3), np.uint8))
    return ShownRun(str(folder), moments, points, colours, scale_words(folder))


def read_moments(folder: Path) -> list[Moment]:
    """The frames of a run, at their final poses where they have one, else as they were given live."""
    try:
        with (folder / "states.csv").open(newline="") as file:
            rows = [row for row in csv.DictReader(file) if None not in row.values()]
        times = np.array([float(row["timestamp"]) for row in rows])
        views = [name.removesuffix("_inliers") for name in (rows or [{}])[0] if name.endswith("_inliers")]
        seen = [{v: (int(r[f"{v}_inliers"]), int(r[f"{v}_predicted"])) for v in views} for r in rows]
        named = [(row["status"], row["keyframe"] == "1") for row in rows]
    except (OSError, ValueError, KeyError, csv.Error) as error:
        raise SourceError(f"{folder / 'states.csv'}: damaged ({error})") from error
    poses: dict[int, np.ndarray] = {}
    if (folder / "trajectory.tum").is_file() and len(times):
        tracked, found = read_tum(folder / "trajectory.tum")
        poses = {int(k): found[row] for row, k in zip(*associate(tracked, times, _WITHIN))}
    if not poses:
        raise SourceError(f"{folder}: no frame of this run has a pose; there is nothing to show")
    return [
        Moment(float(time), status, keyframe, poses.get(k), seen[k])
        for k, (time, (status, keyframe)) in enumerate(zip(times, named))
    ]


def scale_words(folder: Path) -> str:
    """Whether lengths can be trusted, as the summary has it."""
    path = folder / "summary.json"
    if not path.is_file():
        return "NOT METRIC: the run is not finished"
    try:
        summary = json.loads(path.read_text())
        sigma = summary["scale_sigma"]
        known = "" if sigma is None else f" (± {100 * sigma:.2g} %)"
        return ("METRIC" if summary["metric"] else "NOT METRIC") + known
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise SourceError(f"{path}: damaged ({error})") from error
