"""Errors of scales against their sigmas over many runs: films of other rigs that begin some frames later.

Beside the scale of each map what its hand-overs want of it is compared with the truth, in sigmas of their
scatter: by so much, about, `facetcam.slam.scale.evidence` counts them as less sure.

What a map of a hard film becomes hangs on chance; films that begin elsewhere draw again. Films are rendered
once into a cache folder, as by `slam_rigs.py`.
"""

from __future__ import annotations

import argparse
import os
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from _common import data_folder, show
from _rig_films import ELSEWHERE, FILMS, render

from facetcam.evaluation.trajectory import evaluate
from facetcam.pipelines.inputs import read_slam_inputs
from facetcam.slam import Slam

COLUMNS = ("film", "from frame", "with a pose", "ATE cm", "scale", "off", "in sigmas")


class Case(NamedTuple):
    """A film from one of its frames on."""

    name: str
    folder: Path
    start: int
    wheels: bool


class Result(NamedTuple):
    """Share of the frames with a pose, error in metres, error of the scale and its sigma; metric or not.

    `handovers` is the error of what hand-overs want, in sigmas of their scatter; nan where there are none.
    """

    tracked: float
    ate: float
    off: float
    sigma: float
    metric: bool
    handovers: float

    @property
    def in_sigmas(self) -> float:
        return abs(self.off) / self.sigma


def run(case: Case) -> Result | None:
    """Track one film; None where there is no path."""
    cv2.setNumThreads(1)
    film, rig, truth = (case.folder / name for name in ("film.mp4", "rig_true.yaml", "truth.tum"))
    wheels = case.folder / "odometry.csv" if case.wheels else None
    inputs = read_slam_inputs(film, rig, wheels, truth, None, None, None)
    assert inputs.truth is not None
    slam, frames = Slam(inputs.rig), 0
    with inputs.source:
        for frame in inputs.source:
            if frame.index < case.start:
                continue
            slam.track(frame.image, frame.timestamp, inputs.odometry_at(frame.timestamp))
            frames += 1
    slam.finish()
    path = slam.trajectory()
    if len(path[0]) < 3:
        return None
    errors = evaluate(path, inputs.truth, 0.02)
    tracked, off = len(path[0]) / frames, errors.scale_error
    return Result(tracked, errors.ate.rmse, off, slam.scale_sigma, slam.metric, handover_error(slam, off))


def handover_error(slam: Slam, off: float) -> float:
    """How far what hand-overs want of a map's scale is from the truth, in sigmas."""
    told = slam._parts.mapper.handovers.evidence()
    return float((np.log1p(off) + told.stretch) / told.sigma) if np.isfinite(told.sigma) else np.nan


def row(case: Case, result: Result | None) -> list[str]:
    name = f"{case.name}{' + wheels' if case.wheels else ''}"
    if result is None:
        return [name, str(case.start), "no path"]
    says = f"METRIC ± {100 * result.sigma:.2g} %" if result.metric else "NOT METRIC"
    return [
        name,
        str(case.start),
        f"{100 * result.tracked:.0f} %",
        f"{100 * result.ate:.1f}",
        says,
        f"{100 * result.off:+.2f} %",
        f"{result.in_sigmas:.1f}" if result.metric else "",
    ]


def words(results: list[Result]) -> str:
    """What all runs together say."""
    metric = np.array([r.in_sigmas for r in results if r.metric])
    told = np.array([r.handovers for r in results if r.metric])
    rms, told_rms = (np.sqrt(np.mean(x**2)) if len(x) else np.nan for x in (metric, told))
    return (
        f"{len(results)} runs: {len(metric)} METRIC, {np.sum(metric > 3)} of them off by over three sigmas"
        f" ({metric.max(initial=0.0):.1f} at most, root mean square {rms:.2f}),"
        f" what their hand-overs want by {told_rms:.2f} of its scatter;"
        f" ATE {100 * np.median([r.ate for r in results]):.2f} cm at the median"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cache", type=Path, default=Path("rig_films"), help="folder of films")
    parser.add_argument("--only", default="", help="only films whose name holds this")
    parser.add_argument("--starts", type=int, nargs="+", default=[0, 5, 11], help="first frames")
    options = parser.parse_args()
    scene = data_folder() / "house" / "small_house.glb"
    chosen = [film for film in [*FILMS, *ELSEWHERE] if options.only in film.name]
    folders = [(film.name, render(film, scene, options.cache)) for film in chosen]
    cases = [Case(*f, start, w) for f, start, w in product(folders, options.starts, (False, True))]
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        results = list(pool.map(run, cases))
    show("films that begin later", COLUMNS, [row(c, r) for c, r in zip(cases, results)])
    print(words([r for r in results if r is not None]))


if __name__ == "__main__":
    main()
