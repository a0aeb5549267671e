"""The whole line on a built-in scene whose truth is known: film, views, corners, trajectory, report."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path

from facetcam.io.outputs import fresh_folder
from facetcam.pipelines.demo_checks import light_checks, trajectory_checks, view_check
from facetcam.pipelines.demo_film import demo_film, shoot
from facetcam.pipelines.demo_views import view_pairs
from facetcam.pipelines.inputs import read_slam_inputs
from facetcam.pipelines.progress import Progress, silent
from facetcam.pipelines.slam import track_film
from facetcam.viz.pages import write_demo_report
from facetcam.viz.report import Check, DemoReport, Picture

FRAMES, QUICK_FRAMES = 100, 30

Stage = Callable[[str], AbstractContextManager[Progress]]
"""Opened with the name of each stage; gives what to call as it goes on."""


@dataclass(frozen=True, slots=True)
class Demo:
    """What the demo found: quantities against the truth, and the page that shows them."""

    checks: tuple[Check, ...]
    report: Path

    @property
    def passed(self) -> bool:
        """Whether every quantity is as expected."""
        return all(check.passed for check in self.checks)


def unwatched(name: str) -> AbstractContextManager[Progress]:
    """Open a stage that nobody watches."""
    return nullcontext(silent)


def run_demo(out: Path | str, *, quick: bool = False, stage: Stage = unwatched) -> Demo:
    """Render a film of a furnished room through the paper's rig, track it, and compare with the truth.

    Parameters
    ----------
    out : path
        Folder to make. Besides the report it holds the film with its rig, odometry and truth, ready for
        `facetcam slam` and `facetcam unwrap`.
    quick : bool
        A third of the drive.
    stage : callable
        Opens a progress bar for each stage.

    Raises
    ------
    OutputError
        If the folder exists or a file cannot be written.
    """
    folder = fresh_folder(out)
    film = demo_film(QUICK_FRAMES if quick else FRAMES)
    with stage("filming") as progress:
        files = shoot(film, folder, progress)
    with stage("tracking") as progress:
        inputs = read_slam_inputs(files.film, files.rig, files.odometry, files.truth, None, None, None)
        results = track_film(inputs, folder / "slam", progress=progress)
    middle = len(film) // 2
    with stage("comparing") as progress:
        pairs = view_pairs(film, middle)
        checks = [*trajectory_checks(results.summary, film), view_check(pairs), *light_checks(film, middle)]
        progress(1, 1)
    frame = Picture("raw frame", film.still(middle, 0.0, film.exposure(middle, 0.0)))
    slam = replace(results.report, title="A drive through the built-in room")
    report = DemoReport(slam, frame, [pair.picture(i) for i, pair in enumerate(pairs)], checks)
    write_demo_report(report, folder / "report.html")
    return Demo(tuple(checks), folder / "report.html")
