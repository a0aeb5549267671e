"""What a rig sees: on the sensor, on the sphere; how well it can be built; which designs were tried."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam.design.analysis import Analysis, gaps_of, seen_on_horizon
from facetcam.design.search import Found, pareto
from facetcam.design.sensor import CAUSES
from facetcam.design.spec import GOALS
from facetcam.design.tolerance import ToleranceReport
from facetcam.viz.figures import ERROR_COLOUR, INK, MUTED, legend_above, new_figure, plain, to_svg
from facetcam.viz.palette import view_colour

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.image import AxesImage

Array = NDArray[np.float64]

DEAD_COLOURS = ("#c9ced6", "#3b4350", "#8d97a5", "#000000")  # in the order of CAUSES
BEFORE_COLOUR, AFTER_COLOUR = "#e8890c", "#1aa179"
SEAM_COLOUR = "#ffe14d"
_STEP = math.radians(0.5)
_WIDEST_PICTURE = 800  # pixels


def sensor_figure(analysis: Analysis) -> str:
    """Which view every pixel serves, why the others are dead, and where a finite aperture mixes two views."""
    from matplotlib.patches import Patch

    figure, axes = new_figure(5.8, 4.7)
    sensor = analysis.sensor
    _show(axes, analysis, _sensor_picture(analysis))
    shown = [(view_colour(i), name) for i, name in enumerate(analysis.rig.view_names)]
    shown += [(DEAD_COLOURS[i], c) for i, c in enumerate(CAUSES) if (sensor.cause == i).any()]
    shown += [(SEAM_COLOUR, "seam band")] if analysis.seams else []
    axes.legend(
        handles=[Patch(color=colour, label=words) for colour, words in shown], loc="lower left",
        bbox_to_anchor=(0.0, 1.0), ncols=4, frameon=False, labelcolor=INK, fontsize=8, handlelength=1.0,
    )  # fmt: skip
    return to_svg(figure)


def density_figure(analysis: Analysis) -> str:
    """Pixels per degree over the sensor, where it serves a view."""
    figure, axes = new_figure(5.8, 4.7)
    sensor = analysis.sensor
    drawn = _show(axes, analysis, np.where(sensor.view >= 0, sensor.per_degree, np.nan))
    bar = figure.colorbar(drawn, ax=axes, shrink=0.8)
    bar.set_label("pixels per degree", color=MUTED)
    bar.ax.tick_params(colors=MUTED, length=0)
    bar.outline.set_visible(False)
    return to_svg(figure)


def sphere_figure(analysis: Analysis) -> str:
    """Directions that the views see of far things, with the parts of the horizon that none sees in red."""
    figure, axes = new_figure(11.6, 4.6)
    columns, rows = round(math.tau / _STEP), round(math.pi / _STEP)
    azimuth = (np.arange(columns) + 0.5) * _STEP - math.pi
    elevation = math.pi / 2 - (np.arange(rows) + 0.5) * _STEP
    a, e = np.meshgrid(azimuth, elevation)
    directions = np.stack([np.cos(e) * np.sin(a), np.cos(e) * np.cos(a), np.sin(e)], axis=-1).reshape(-1, 3)
    picture = np.zeros((rows, columns, 4))
    for index, (name, area) in enumerate(analysis.areas.items()):
        seen = area.sees(directions).reshape(rows, columns)
        fresh = seen & (picture[..., 3] == 0)
        picture[fresh] = (*_rgb(view_colour(index)), 0.45)
        picture[seen & ~fresh] = (*_rgb(view_colour(index)), 0.85)
        _outline(axes, analysis, name, view_colour(index))
    axes.imshow(picture, extent=(-180, 180, -90, 90), interpolation="nearest", aspect="auto")
    for start, end in gaps_of(seen_on_horizon(analysis.areas)):
        for turn in (-360.0, 0.0, 360.0):
            ends = [math.degrees(start) + turn, math.degrees(end) + turn]
            axes.plot(ends, [0, 0], color=ERROR_COLOUR, lw=2.6, solid_capstyle="butt", alpha=0.9)
    low, high = _elevations(analysis)
    axes.set_xlim(-180, 180)
    axes.set_ylim(low, high)
    axes.set_xticks(range(-180, 181, 45))
    axes.set_xlabel("azimuth from the front to the right (degrees)")
    axes.set_ylabel("elevation (degrees)")
    legend_above(axes, 8)
    return to_svg(figure)


def tolerance_figure(report: ToleranceReport) -> str:
    """Pixel error of each build in each view, as built and after calibration."""
    figure, axes = new_figure(6.8, 1.2 + 0.7 * len(report.views))
    jitter = np.random.default_rng(0).uniform(-0.11, 0.11, len(report.before))
    for row in range(len(report.views)):
        for errors, colour, shift, words in (
            (report.before, BEFORE_COLOUR, -0.16, "as built"),
            (report.after, AFTER_COLOUR, 0.16, "calibrated"),
        ):
            label = words if row == 0 else None
            axes.plot(
                np.maximum(errors[:, row], 1e-3), row + shift + jitter, ".", ms=4, color=colour, alpha=0.5,
                mew=0, rasterized=True, label=label,
            )  # fmt: skip
            middle = float(np.median(errors[:, row]))
            axes.plot([middle, middle], [row + shift - 0.15, row + shift + 0.15], color=INK, lw=1.6)
            axes.annotate(
                f"{middle:.2g}", (middle, row + shift - 0.2), color=INK, fontsize=8, ha="center", va="bottom"
            )
    axes.set_yticks(range(len(report.views)), list(report.views))
    axes.invert_yaxis()
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.minorticks_off()
    axes.set_xlabel("root mean square error of each build (pixels); bars: medians")
    legend_above(axes, 2, dots=2.5)
    return to_svg(figure)


def search_figure(found: Found) -> str:
    """All candidates that can be built, those that no other beats, and the score over the generations."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.6, 4.0), layout="constrained", facecolor="none")
    cloud, history = figure.subplots(1, 2, width_ratios=(1.5, 1))
    x, y, unit, other = 0, *_second_quality(found)
    table = found.candidates * (100.0, 1.0, 1000.0, 100.0)
    front = table[pareto(found.candidates[:, [x, y]])]
    front = front[np.argsort(front[:, x])]
    cloud.plot(
        table[:, x],
        table[:, y],
        ".",
        ms=3,
        color=MUTED,
        alpha=0.5,
        mew=0,
        rasterized=True,
        label="candidates",
    )
    cloud.plot(front[:, x], front[:, y], "-o", ms=3.5, lw=1.2, color=view_colour(0), label="beaten by none")
    for quality, marker, colour, words in (
        (found.start, "s", BEFORE_COLOUR, "start"), (found.best, "D", AFTER_COLOUR, "best"),
    ):  # fmt: skip
        if quality is not None:
            values = np.array([getattr(quality, name) for name in GOALS]) * (100.0, 1.0, 1000.0, 100.0)
            cloud.plot(values[x], values[y], marker, ms=9, color=colour, mec=INK, label=words)
    cloud.set_xlabel("coverage of the band about the horizon (%)")
    cloud.set_ylabel(f"{other} ({unit})")
    history.plot(range(1, len(found.history) + 1), found.history, color=AFTER_COLOUR, lw=1.8)
    history.set_xlabel("generation")
    history.set_ylabel("best score")
    for axes in (cloud, history):
        axes.set_facecolor("none")
        plain(axes)
    legend_above(cloud, 4)
    return to_svg(figure)


def _second_quality(found: Found) -> tuple[int, str, str]:
    """The quality to draw against coverage: the one weighted most that varies, else the baseline."""
    goal = found.spec.search.goal
    weights = {name: getattr(goal, name) for name in GOALS[1:]}
    varies = {name: np.ptp(found.candidates[:, GOALS.index(name)]) > 1e-9 for name in weights}
    name = max(weights, key=lambda n: (varies[n], weights[n], n == "baseline"))
    units = {"resolution": "pixels per degree", "baseline": "mm", "overlap": "% of the band"}
    return GOALS.index(name), units[name], name


def _show(axes: Axes, analysis: Analysis, picture: NDArray[Any]) -> AxesImage:
    """Show numbers or colours of the sensor's pixels, thinned to what a page can show."""
    width, height = analysis.rig.size
    thin = max(1, picture.shape[1] // _WIDEST_PICTURE)
    axes.grid(visible=False)
    axes.set_xlabel("column (pixels)")
    axes.set_ylabel("row (pixels)")
    extent = (-0.5, width - 0.5, height - 0.5, -0.5)
    return axes.imshow(picture[::thin, ::thin], extent=extent, interpolation="nearest", cmap="viridis")


def _sensor_picture(analysis: Analysis) -> NDArray[np.uint8]:
    sensor = analysis.sensor
    colours = [view_colour(i) for i in range(len(analysis.rig.view_names))]
    table = np.array([_rgb(colour) for colour in (*colours, *DEAD_COLOURS)])
    index = np.where(sensor.view >= 0, sensor.view, sensor.cause + len(colours))
    picture = (255 * table[index]).astype(np.uint8)
    picture[_bands(analysis)] = [round(255 * c) for c in _rgb(SEAM_COLOUR)]
    return picture


def _bands(analysis: Analysis) -> NDArray[np.bool_]:
    """Pixels within half the width of the blurred band of a view's edge."""
    sensor = analysis.sensor
    band = np.zeros(sensor.view.shape, dtype=bool)
    for seam in analysis.seams:
        inside = (sensor.view == analysis.rig.view_names.index(seam.view)).astype(np.uint8)
        if inside.any() and not inside.all():
            distance = cv2.distanceTransform(inside, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
            band |= (inside == 1) & (distance * sensor.step <= seam.widest / 2)
    return band


def _outline(axes: Axes, analysis: Analysis, name: str, colour: str) -> None:
    label: str | None = name
    for ring in analysis.views[name].polygon:
        degrees = np.degrees(ring)
        jumps = np.flatnonzero(np.abs(np.diff(degrees[:, 0])) > 180.0) + 1
        axes.plot(*np.insert(degrees, jumps, np.nan, axis=0).T, color=colour, lw=1.6, label=label)
        label = None


def _elevations(analysis: Analysis) -> tuple[float, float]:
    ends = np.array([view.elevation for view in analysis.views.values()])
    if analysis.horizon > 0.0:
        ends = np.vstack([ends, np.zeros((1, 2))])
    room = math.radians(8.0)
    low, high = max(ends.min() - room, -math.pi / 2), min(ends.max() + room, math.pi / 2)
    return math.degrees(low), math.degrees(high)


def _rgb(colour: str) -> tuple[float, float, float]:
    red, green, blue = bytes.fromhex(colour[1:])
    return red / 255, green / 255, blue / 255
