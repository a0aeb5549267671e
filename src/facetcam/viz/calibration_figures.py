"""Figures of a calibration: residuals and coverage on the sensor, uncertainty maps, residuals by photo."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from facetcam.viz.calibration_words import digits_of, number
from facetcam.viz.figures import BAR_COLOUR, ERROR_COLOUR, INK, LINE, MUTED, TRUTH_COLOUR, to_svg
from facetcam.viz.palette import view_colour

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import QuadMesh
    from matplotlib.figure import Figure

    from facetcam.calibration.quality import UncertaintyMap
    from facetcam.calibration.result import Calibration, FittedSighting

Array = NDArray[np.float64]

_COLUMNS = 4  # panels a row
_WIDTH, _HEIGHT = 11.6, 4.6  # inches of a row of panels, at most
_BAR = 0.55  # inches of a bar of colours
_MARGIN = 0.06  # of a panel's size round what it shows
_MOST_ARROWS = 1200  # a view


def residual_fields(names: Sequence[str], sightings: Sequence[FittedSighting]) -> str:
    """Residual vectors of every view where they are on the sensor, long enough to see."""
    of_view = {name: [f for f in sightings if f.sighting.view == name] for name in names}
    of_view = {name: fitted for name, fitted in of_view.items() if fitted}
    kept = [f.residuals[f.kept] for f in sightings]
    lengths = np.linalg.norm(np.concatenate([*kept, np.empty((0, 2))]), axis=1)
    typical = float(np.sqrt(np.mean(lengths**2))) if len(lengths) else 1.0
    shown = {name: np.concatenate([f.sighting.pixels for f in fitted]) for name, fitted in of_view.items()}
    figure, panels = panels_of(shown)
    for name, axes in panels.items():
        fitted = of_view[name]
        at = np.concatenate([f.sighting.pixels[f.kept] for f in fitted])
        off = np.concatenate([f.residuals[f.kept] for f in fitted])
        out = np.concatenate([f.sighting.pixels[~f.kept] for f in fitted])
        longer = 0.022 * float(np.ptp(shown[name], axis=0).max()) / max(typical, 1e-9)
        some = slice(None, None, max(1, len(at) // _MOST_ARROWS))
        axes.quiver(
            *at[some].T, *(longer * off[some]).T, color=view_colour(names.index(name)), angles="xy",
            scale_units="xy", scale=1.0, units="inches", width=0.011, headwidth=3.5, headlength=4.0,
        )  # fmt: skip
        axes.plot(*out.T, "x", ms=4.5, mew=1.1, color=ERROR_COLOUR)
        rms = float(np.sqrt(np.mean(np.sum(off**2, axis=1)))) if len(off) else float("nan")
        titled(axes, name, f"{rms:.3f} px RMS\narrows × {longer:.0f}")
    return to_svg(figure)


def coverage(calibration: Calibration) -> str:
    """Where on the sensor corners were seen, view by view, and how they spread over its area."""
    views = list(calibration.rig.view_names)
    width, height = calibration.rig.size
    step = max(width, height) / 160
    u, v = np.meshgrid(np.arange(step / 2, width, step), np.arange(step / 2, height, step))
    grid = np.stack([u.ravel(), v.ravel()], axis=1)
    area_of = {name: calibration.rig.sees(name, grid) for name in views}
    seen = {
        name: np.concatenate(
            [*(f.sighting.pixels[f.kept] for f in _of_view(calibration, name)), np.empty((0, 2))]
        )
        for name in views
    }
    figure, panels = panels_of({name: np.concatenate([grid[area_of[name]], seen[name]]) for name in views})
    for index, (name, axes) in enumerate(panels.items()):
        inside, at = area_of[name], seen[name]
        area = inside.reshape(u.shape).astype(float)
        if inside.any() and not inside.all():
            axes.contour(u, v, area, levels=[0.5], colors=[MUTED], linewidths=0.8)
        axes.plot(*at.T, ".", ms=2.4, color=view_colour(index), alpha=0.75, rasterized=len(at) > 3000)
        covered = covered_share(grid[inside], at, 0.12 * math.sqrt(max(inside.sum(), 1)) * step)
        titled(axes, name, f"{len(at)} corners\n{100 * covered:.0f} % of the area")
    return to_svg(figure)


def covered_share(area: Array, corners: Array, reach: float) -> float:
    """Share of an area's pixels (N, 2) that have a corner within `reach`."""
    if not len(area) or not len(corners):
        return 0.0
    from scipy.spatial import cKDTree

    distance = cKDTree(corners).query(area, distance_upper_bound=reach)[0]
    return float(np.isfinite(distance).mean())


def uncertainty_maps(maps: Sequence[UncertaintyMap], names: Sequence[str]) -> str:
    """Sigma of where a point is seen, over each view, one scale of colours for all."""
    import matplotlib as mpl
    from matplotlib.colors import LogNorm

    known_of = {m.view: np.isfinite(m.sigma_px) for m in maps}
    figure, panels = panels_of(
        {m.view: np.stack([m.u[known_of[m.view]], m.v[known_of[m.view]]], axis=1) for m in maps}
    )
    known = np.concatenate([m.sigma_px[np.isfinite(m.sigma_px) & (m.sigma_px > 0)] for m in maps])
    low, high = np.percentile(known, [1, 99]) if len(known) else (0.01, 1.0)
    norm = LogNorm(max(float(low), 1e-6), max(float(high), 1.2 * float(low), 2e-6))
    drawn = None
    for entry in maps:
        axes = panels[entry.view]
        if not known_of[entry.view].any():
            titled(axes, entry.view, "not determined")
            continue
        drawn = axes.pcolormesh(
            entry.u, entry.v, np.ma.masked_invalid(entry.sigma_px), norm=norm,
            cmap=mpl.colormaps["viridis"], shading="nearest", rasterized=True,
        )  # fmt: skip
        titled(
            axes,
            entry.view,
            f"{_middle(entry.sigma_px)} px\n{_middle(entry.sigma_mm)} mm",
        )
    if drawn is not None:
        _colour_bar(figure, drawn)
    return to_svg(figure)


def _colour_bar(figure: Figure, drawn: QuadMesh) -> None:
    """A bar below all panels, for which the figure grows: they keep their size."""
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    width, height = figure.get_size_inches()
    share = _BAR / (height + _BAR)
    figure.set_size_inches(width, height + _BAR)
    figure.set_layout_engine(ConstrainedLayoutEngine(rect=(0.0, share, 1.0, 1.0 - share)))
    place = figure.add_axes((0.03, 0.7 * share, 0.4, 0.18 * share))
    bar = figure.colorbar(drawn, cax=place, orientation="horizontal")
    bar.outline.set_visible(False)
    bar.ax.tick_params(colors=MUTED, length=0, which="both", labelsize=8)
    bar.set_label("sigma (px)", color=MUTED)
    marks = np.geomspace(drawn.norm.vmin or 1e-6, drawn.norm.vmax or 1.0, 4).tolist()
    bar.set_ticks(marks, labels=[number(mark, digits_of(mark, 0)) for mark in marks])
    bar.minorticks_off()


def residuals_by_photo(rms: Sequence[float], held_out: Mapping[int, float]) -> str:
    """Residual of each photo in the solve and, where it was left out, when it is predicted."""
    from facetcam.viz.figures import legend_above, new_figure

    figure, axes = new_figure(11.6, 2.7)
    at = np.arange(len(rms))
    axes.bar(at, np.nan_to_num(rms), width=0.62, color=BAR_COLOUR, alpha=0.85, label="in the solve")
    if held_out:
        axes.plot(list(held_out), list(held_out.values()), "o", ms=4, color=TRUTH_COLOUR, label="held out")
    axes.grid(axis="x", visible=False)
    axes.set_xlim(-0.8, len(rms) - 0.2)
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("photo")
    axes.set_ylabel("RMS (px)")
    legend_above(axes, 2)
    return to_svg(figure)


def panels_of(shown: Mapping[str, Array]) -> tuple[Figure, dict[str, Axes]]:
    """One panel a name, y downward as on the sensor, each as wide as the points (N, 2) it shows ask for."""
    from matplotlib.figure import Figure

    columns = math.ceil(len(shown) / max(math.ceil(len(shown) / _COLUMNS), 1))
    rows = [list(shown.items())[k : k + columns] for k in range(0, len(shown), max(columns, 1))]
    aspects = [[_aspect(points) for _, points in row] for row in rows]
    height = min([_WIDTH / sum(row) for row in aspects] + [_HEIGHT])  # a last row of few is no higher
    figure = Figure(figsize=(_WIDTH, len(rows) * (height + 0.45)), layout="constrained", facecolor="none")
    panels = {}
    grid = figure.add_gridspec(len(rows), 1)
    for index, (row, ratios) in enumerate(zip(rows, aspects)):
        # What narrow views leave of the row stays empty at its end.
        rest = max(_WIDTH / height - sum(ratios), 1e-3)
        cells = grid[index].subgridspec(1, len(row) + 1, width_ratios=[*ratios, rest])
        for column, (name, points) in enumerate(row):
            axes = figure.add_subplot(cells[column], facecolor="none", aspect="equal", anchor="W")
            axes.set_xticks([])
            axes.set_yticks([])
            axes.spines[:].set_color(LINE)
            frame_of(axes, points)
            panels[name] = axes
    return figure, panels


def _aspect(points: Array) -> float:
    """Width of a panel over its height, within reason, so that words find room below it."""
    if not len(points):
        return 1.0
    wide, high = np.ptp(points, axis=0)
    margin = _MARGIN * max(wide, high, 1.0)
    return float(np.clip((wide + 2 * margin) / (high + 2 * margin), 0.75, 3.0))


def frame_of(axes: Axes, points: Array) -> None:
    """Let the panel show all points (N, 2)."""
    if not len(points):
        return
    low, high = points.min(axis=0), points.max(axis=0)
    span = float(max((high - low).max(), 1.0))
    axes.set_xlim(low[0] - _MARGIN * span, high[0] + _MARGIN * span)
    axes.set_ylim(high[1] + _MARGIN * span, low[1] - _MARGIN * span)


def titled(axes: Axes, name: str, words: str) -> None:
    axes.set_title(name, color=INK, fontsize=10.5, loc="left", pad=4)
    axes.set_xlabel(words, color=MUTED, fontsize=8.5, loc="left")


def _of_view(calibration: Calibration, name: str) -> list[FittedSighting]:
    return [f for f in calibration.sightings if f.sighting.view == name]


def _middle(sigmas: Array) -> str:
    """Their median, with the two digits that count."""
    middle = float(np.nanmedian(sigmas))
    return number(middle, digits_of(middle, 0))
