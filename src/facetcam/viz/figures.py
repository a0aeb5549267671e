"""Figures for a report, as SVG that takes its ink from the page and so works on light and dark ground."""

from __future__ import annotations

import io
import warnings
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from facetcam.viz.palette import view_colour

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# matplotlib writes fixed colours; these marks are replaced by the page's CSS variables afterwards.
INK, MUTED, LINE, CARD = "#010203", "#040506", "#070809", "#0a0b0c"
CSS_OF_MARK = {INK: "var(--ink)", MUTED: "var(--muted)", LINE: "var(--line)", CARD: "var(--card)"}
COLOUR_OF_CSS = {
    "var(--ink)": "#1b1f24",
    "var(--muted)": "#6b7480",
    "var(--line)": "#e3e6ea",
    "var(--card)": "#fff",
}
BAR_COLOUR, TRUTH_COLOUR, ERROR_COLOUR, CLOUD_COLOUR = "#1aa179", "#e8890c", "#e5484d", "#8a94a3"
GAP = 5.0  # times the usual step, from which frames are missing
APART_COLUMNS = 3
MAX_SAMPLES = 1500  # along time; more would only make the page heavy

Array = NDArray[np.floating]


def path_figure(
    times: Array, path: Array, keyframes: Array, cloud: Array, truth: Array | None, unit: str = "m"
) -> str:
    """Path (N, 3) over `times`, keyframes (K, 3), map (P, 3) and truth (N, 3) from above, in `unit`."""
    figure, axes = new_figure(6.8, 6.2)
    plane = ground(path)
    if len(cloud):
        seen = near(cloud[:, plane], path[:, plane])
        # Thousands of vector dots would weigh megabytes: this one layer is a picture inside the SVG.
        axes.plot(*seen.T, ".", ms=1.6, color=CLOUD_COLOUR, alpha=0.55, rasterized=True, label="map")
    if truth is not None:
        true = broken(times, truth[:, plane])
        axes.plot(*true.T, color=TRUTH_COLOUR, lw=2.4, alpha=0.8, label="truth, aligned")
    draw_way(axes, times, path[:, plane])
    axes.plot(*keyframes[:, plane].T, "o", ms=2.6, color=view_colour(0), label="keyframes")
    name_axes(axes, plane, unit)
    legend_above(axes, 5)
    return to_svg(figure)


def apart_figure(ways: Mapping[str, tuple[Array, Array]], unit: str) -> str:
    """Paths in several maps from above, a panel each: by name, times (N,) and positions (N, 3) in `unit`."""
    from matplotlib.figure import Figure

    rows = -(-len(ways) // APART_COLUMNS)
    figure = Figure(figsize=(11.6, 3.4 * rows), layout="constrained", facecolor="none")
    for i, (name, (times, path)) in enumerate(ways.items(), start=1):
        plane, panel = ground(path), figure.add_subplot(rows, APART_COLUMNS, i, facecolor="none")
        plain(panel)
        draw_way(panel, times, path[:, plane])
        panel.set_title(name, color=INK, fontsize=10, loc="left")
        name_axes(panel, plane, unit)
    return to_svg(figure)


def draw_way(axes: Axes, times: Array, path: Array) -> None:
    """A path (N, 2), broken where frames have no pose, and where it starts."""
    axes.plot(*broken(times, path).T, color=view_colour(0), lw=1.5, label="estimate")
    axes.plot(*path[0], "o", ms=8, mfc="none", mec=INK, mew=1.3, label="start")


def broken(times: Array, values: Array) -> Array:
    """Rows over `times`, with a row of nan where frames are missing, so that no line is drawn there."""
    steps = np.diff(times)
    usual = np.median(steps) if len(steps) else 0.0
    gaps = np.flatnonzero(steps > GAP * usual) + 1
    inserted: Array = np.insert(values.astype(float), gaps, np.nan, axis=0)
    return inserted


def name_axes(axes: Axes, plane: list[int], unit: str) -> None:
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel(f"{'xyz'[plane[0]]} ({unit})")
    axes.set_ylabel(f"{'xyz'[plane[1]]} ({unit})")


def counts_figure(times: Array, inliers: NDArray[np.integer], predicted: Array, names: Sequence[str]) -> str:
    """Measured map points (N, V) of each view stacked over `times` (s); a line shows those expected (N,)."""
    figure, axes = new_figure(11.6, 3.0)
    keep = thinned(len(times))
    seconds = times[keep] - times[0]
    colours = [view_colour(i) for i in range(len(names))]
    axes.stackplot(seconds, inliers[keep].T, colors=colours, alpha=0.75, labels=names, lw=0)
    axes.plot(seconds, predicted[keep], color=MUTED, lw=0.8, label="expected")
    over_time(axes, seconds, "points")
    legend_above(axes, len(names) + 1)
    return to_svg(figure)


def error_figure(times: Array, errors: Array) -> str:
    """Distance to the truth (M,) in metres over `times` (s), with its root mean square."""
    figure, axes = new_figure(11.6, 2.6)
    keep = thinned(len(times))
    seconds = broken(times[keep], times[keep] - times[0])
    centimetres = broken(times[keep], 100.0 * errors[keep])
    rms = 100.0 * float(np.sqrt(np.mean(errors**2)))
    axes.fill_between(seconds, centimetres, color=ERROR_COLOUR, alpha=0.18, lw=0)
    axes.plot(seconds, centimetres, color=ERROR_COLOUR, lw=1.3, label="distance to truth")
    axes.axhline(rms, color=MUTED, lw=1.0, ls=(0, (5, 3)), label=f"root mean square {rms:.2f} cm")
    over_time(axes, seconds, "cm")
    legend_above(axes, 2)
    return to_svg(figure)


def scores_figure(scores: Mapping[str, float], label: str) -> str:
    """One bar a name, the first on top."""
    figure, axes = new_figure(6.0, 0.8 + 0.3 * len(scores))
    names = list(scores)
    bars = axes.barh(range(len(names)), list(scores.values()), height=0.62, color=BAR_COLOUR, alpha=0.85)
    axes.bar_label(bars, fmt="%.3f", padding=4, color=INK)
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()
    axes.grid(axis="y", visible=False)
    axes.set_xlim(0.0, 1.15 * max(*scores.values(), 0.01))  # room for the figures
    axes.set_xlabel(label)
    return to_svg(figure)


def timing_figure(stages: Mapping[str, Sequence[float]]) -> str:
    """Where the time of a run went: seconds of each stage in all, with its calls and their median."""
    named = [(name, np.asarray(seconds)) for name, seconds in stages.items() if len(seconds)]
    figure, axes = new_figure(11.6, 0.7 + 0.26 * len(named))
    for row, (_, seconds) in enumerate(named):
        axes.barh(row, seconds.sum(), height=0.62, color=BAR_COLOUR, alpha=0.85)
        calls = f"{len(seconds)} × {1000.0 * np.median(seconds):.1f} ms"
        end = axes.annotate(calls, (seconds.sum(), row), (5, 0), textcoords="offset points", color=INK)
        end.set_verticalalignment("center")
    axes.set_yticks(range(len(named)), [name for name, _ in named])
    axes.invert_yaxis()
    axes.grid(axis="y", visible=False)
    axes.set_xlim(0.0, 1.15 * max(seconds.sum() for _, seconds in named))  # room for the words
    axes.set_xlabel("seconds in all; calls × median")
    return to_svg(figure)


def ground(path: Array) -> list[int]:
    """The two axes along which a path spreads most: x, y for a rig that drives or walks with its z up.

    An ordinary camera may keep its own axes, z forward and y down; its ground is then x, z.
    """
    spread = np.ptp(path, axis=0)
    level = max(range(3), key=lambda axis: (-spread[axis], axis))
    return [axis for axis in range(3) if axis != level]


def near(points: Array, path: Array) -> Array:
    """The map points (P, 2) worth drawing: not those so far off that the path would shrink to a dot."""
    middle = path.mean(axis=0)
    distance = np.linalg.norm(points - middle, axis=1)
    reach = np.linalg.norm(path - middle, axis=1).max()
    kept: Array = points[distance <= max(np.percentile(distance, 95), 1.5 * reach)]
    return kept


def thinned(count: int) -> slice:
    return slice(None, None, max(1, count // MAX_SAMPLES))


def over_time(axes: Axes, seconds: Array, unit: str) -> None:
    axes.set_xlim(0.0, max(float(seconds[-1]), 1e-3))
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("time (s)")
    axes.set_ylabel(unit)


def legend_above(axes: Axes, columns: int, dots: float = 1.0) -> None:
    """A legend above the axes; `dots` enlarges its markers."""
    axes.legend(
        loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=columns, frameon=False, labelcolor=INK,
        borderaxespad=0.2, handlelength=1.4, columnspacing=1.4, markerscale=dots,
    )  # fmt: skip


def new_figure(width: float, height: float) -> tuple[Figure, Axes]:
    """An empty figure (inches) in the style of the page: no box, faint grid."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained", facecolor="none")
    axes = figure.add_subplot(facecolor="none")
    plain(axes)
    return figure, axes


def plain(axes: Axes) -> None:
    """The style of the page: no box, faint grid, muted words."""
    axes.spines[["top", "right", "left", "bottom"]].set_visible(False)
    axes.grid(color=LINE, lw=0.8)
    axes.set_axisbelow(True)
    axes.tick_params(colors=MUTED, length=0)
    axes.xaxis.label.set_color(MUTED)
    axes.yaxis.label.set_color(MUTED)


def to_svg(figure: Figure) -> str:
    """The `<svg>` element of a figure, its marks replaced by CSS variables and its text left as text."""
    import matplotlib as mpl
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        text.set_parse_math(False)  # names of views come from files: a $ is a $
    buffer = io.StringIO()
    # A fixed salt makes the ids, and so the whole page, the same in every run.
    style = {"svg.fonttype": "none", "svg.hashsalt": "facetcam", "font.size": 10}
    with mpl.rc_context(style), warnings.catch_warnings():
        # A view as thin as a line keeps the place it has; the reader of a terminal cannot widen it.
        warnings.filterwarnings("ignore", message="constrained_layout not applied")
        figure.savefig(buffer, format="svg", dpi=150, metadata={"Date": None})
    svg = buffer.getvalue()
    for mark, css in CSS_OF_MARK.items():
        svg = svg.replace(mark, css)
    return svg[svg.index("<svg") :]


def standalone(svg: str) -> str:
    """A figure as a file of its own: dark ink where a page would bring its own."""
    for css, colour in COLOUR_OF_CSS.items():
        svg = svg.replace(css, colour)
    return svg
