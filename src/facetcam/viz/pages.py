"""Writes each report as one self-contained HTML file; empty and interrupted runs get a page that says so."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from itertools import groupby
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup

from facetcam import __version__
from facetcam.io.outputs import atomic_write
from facetcam.viz import figures, wording
from facetcam.viz.palette import view_colour
from facetcam.viz.pictures import data_uri, draw_points
from facetcam.viz.report import DemoReport, Picture, SlamReport, UnwrapReport

THUMBNAIL_WIDTH = 760  # pixels, enough for half a page on a sharp screen


def write_slam_report(report: SlamReport, path: Path) -> None:
    """Write the page of a SLAM run to `path`.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    write_page("slam.html", path, slam_context(report))


def write_demo_report(report: DemoReport, path: Path) -> None:
    """Write the page of the demo to `path`; raises `OutputError` when it cannot be written."""
    context = slam_context(report.slam) | {"title": report.title}
    context |= {"frame": embedded(report.frame), "views": [embedded(view) for view in report.views]}
    write_page("demo.html", path, context | {"checks": report.checks})


def write_unwrap_report(report: UnwrapReport, path: Path) -> None:
    """Write a contact sheet to `path`; raises `OutputError` when it cannot be written."""
    rows = [[embedded(picture) for picture in row] for row in report.rows]
    write_page("unwrap.html", path, {"report": report, "rows": rows, "title": report.title})


def slam_context(report: SlamReport) -> dict[str, Any]:
    return {
        "title": report.title,
        "report": report,
        "verdict": wording.verdict(report),
        "tiles": wording.tiles(report),
        "figures": slam_figures(report),
        "status_runs": status_runs(report),
        "pictures": [embedded(picture) for picture in report.pictures],
        "view_legend": [(name, view_colour(i)) for i, name in enumerate(report.view_names)],
    }


def slam_figures(report: SlamReport) -> Mapping[str, Markup]:
    """The figures for which the run has data, by name."""
    drawn = {}
    truth = report.truth
    if len(report.positions):
        aligned = truth.positions if truth else None
        unit = "m" if report.metric else "map units"
        way = report.pose_times, report.positions, report.keyframes, report.cloud
        drawn["path"] = figures.path_figure(*way, aligned, unit)
    if report.apart:
        drawn["apart"] = figures.apart_figure(report.apart, "map units")
    if len(report.times) > 1:
        expected = report.predicted.sum(axis=1)
        drawn["counts"] = figures.counts_figure(report.times, report.inliers, expected, report.view_names)
    if truth is not None and len(truth.errors):
        drawn["error"] = figures.error_figure(report.pose_times, truth.errors)
    if any(len(seconds) for seconds in report.timing.values()):
        drawn["timing"] = figures.timing_figure(report.timing)
    return {name: Markup(svg) for name, svg in drawn.items()}


def status_runs(report: SlamReport) -> list[tuple[str, float]]:
    """Stretches of equal status, each with its percentage of the frames."""
    runs = [(status, len(list(group))) for status, group in groupby(report.statuses)]
    return [(status, 100.0 * count / len(report.statuses)) for status, count in runs]


def embedded(picture: Picture) -> dict[str, str]:
    drawn = draw_points(picture.image, picture.points, picture.views, THUMBNAIL_WIDTH)
    return {"caption": picture.caption, "uri": data_uri(drawn)}


def write_page(template: str, path: Path, context: Mapping[str, Any]) -> None:
    page = environment().get_template(template).render(context, version=__version__)
    atomic_write(path, page)


@cache
def environment() -> jinja2.Environment:
    return jinja2.Environment(
        loader=jinja2.PackageLoader("facetcam.viz"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
