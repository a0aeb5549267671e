"""Pictures in space: an empty one, framing what it shows, and where points come to lie."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

_FILLED = 0.92  # share of the width or height that a picture fills


def empty_space(width: float, height: float) -> tuple[Figure, Any]:
    """An empty picture in space, inches wide and high."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), facecolor="none")
    axes: Any = figure.add_axes((0.0, 0.0, 1.0, 1.0), projection="3d", facecolor="none")
    axes.set_axis_off()
    axes.view_init(elev=24, azim=-62)
    return figure, axes


def frame_axes(axes: Any, points: Array) -> None:
    """Show all points (N, 3) in a picture in space, as large as it takes them, with equal scales."""
    low, high = points.min(axis=0), points.max(axis=0)
    for setter, a, b in zip((axes.set_xlim, axes.set_ylim, axes.set_zlim), low, high):
        setter(a, b)
    sides = np.maximum(high - low, 1e-3)
    axes.set_box_aspect(sides)
    axes.set_box_aspect(sides, zoom=_FILLED / (2.0 * np.abs(on_page(axes, points) - 0.5).max()))


def on_page(axes: Any, points: Array) -> Array:
    """Places (N, 2) of points (N, 3) in the square that shows them, from 0 to 1 across and up."""
    from mpl_toolkits.mplot3d.proj3d import proj_transform

    axes.apply_aspect()
    flat = np.column_stack(proj_transform(*points.T, axes.get_proj())[:2])
    page: Array = axes.figure.transFigure.inverted().transform(axes.transData.transform(flat))
    left, bottom, width, height = axes.get_position().bounds
    places: Array = (page - (left, bottom)) / (width, height)
    return places
