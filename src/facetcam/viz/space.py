"""Pictures in space: an empty one, framing what it shows, and where points come to lie."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

_MARGIN = 0.3  # inches between a picture and its edge, for names of what ends there


def empty_space(width: float, height: float) -> tuple[Figure, Any]:
    """An empty picture in space, inches wide and high."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), facecolor="none")
    axes: Any = figure.add_axes((0.0, 0.0, 1.0, 1.0), projection="3d", facecolor="none")
    axes.set_axis_off()
    axes.view_init(elev=24, azim=-62)
    return figure, axes


def frame_axes(axes: Any, points: Array, box: tuple[float, float, float, float] | None = None) -> None:
    """Show all points (N, 3) as large as the picture takes them, with equal scales.

    In `box` (left, bottom, width, height; inches), or in the whole figure, which then becomes no higher than
    the points need.
    """
    low, high = points.min(axis=0), points.max(axis=0)
    for setter, a, b in zip((axes.set_xlim, axes.set_ylim, axes.set_zlim), low, high):
        setter(a, b)
    axes.set_box_aspect(np.maximum(high - low, 1e-3))
    figure = axes.figure
    left, bottom, width, height = box or (0.0, 0.0, *figure.get_size_inches())
    flat = on_page(axes, points)
    spans, middle = np.maximum(np.ptp(flat, axis=0), 1e-3), (flat.min(axis=0) + flat.max(axis=0)) / 2
    side = float(((np.array([width, height]) - 2 * _MARGIN) / spans).min())
    if box is None:
        height = side * spans[1] + 2 * _MARGIN
        figure.set_size_inches(width, height)
    corner = np.array([left + width / 2, bottom + height / 2]) - side * middle
    page = figure.get_size_inches()
    axes.set_position((*(corner / page), *(side / page)))


def on_page(axes: Any, points: Array) -> Array:
    """Places (N, 2) of points (N, 3) in the square that shows them, from 0 to 1 across and up."""
    from mpl_toolkits.mplot3d.proj3d import proj_transform

    axes.apply_aspect()
    flat = np.column_stack(proj_transform(*points.T, axes.get_proj())[:2])
    page: Array = axes.figure.transFigure.inverted().transform(axes.transData.transform(flat))
    left, bottom, width, height = axes.get_position().bounds
    places: Array = (page - (left, bottom)) / (width, height)
    return places
