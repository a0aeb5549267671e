"""Draw docs/images/rig.svg: a cut through the `ryu` rig with its traced camera rays."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from facetcam.rig import Rig, presets
from facetcam.rig.tracing import Tracer
from facetcam.viz.palette import view_colour

BOUNCES = 4
OUTSIDE = 0.14  # metres a ray is drawn after its last mirror
MILLIMETRES = 1000.0


def ray_path(rig: Rig, pixel: tuple[float, float]) -> NDArray[np.float64]:
    """The corner points (N, 3) of one camera ray, from the lens over every mirror it meets into the room."""
    mirrors = list(rig.mirrors.values())
    ray = rig.camera.ray([pixel])
    paths = Tracer(mirrors, rig.T_rig_cam).trace(ray, BOUNCES)
    corners, direction, travelled = [rig.T_rig_cam[:3, 3]], rig.T_rig_cam[:3, :3] @ ray[0], 0.0
    for index, length in zip(paths.mirror[:, 0], paths.length[:, 0], strict=True):
        if index < 0:
            break
        corners.append(corners[-1] + (length - travelled) * direction)
        direction, travelled = mirrors[index].reflection[:3, :3] @ direction, length
    return np.array([*corners, corners[-1] + OUTSIDE * direction])


def draw_mirrors(axes: Axes, rig: Rig) -> None:
    """Every mirror that the plane x = 0 cuts, as the line of the cut."""
    for mirror in rig.mirrors.values():
        polygon = mirror.polygon
        if polygon is None or polygon[:, 0].min() >= 0 or polygon[:, 0].max() <= 0:
            continue
        following = np.roll(polygon, -1, axis=0)
        crossing = polygon[:, 0] * following[:, 0] < 0
        a, b = polygon[crossing], following[crossing]
        cut = a + (b - a) * (a[:, :1] / (a[:, :1] - b[:, :1]))
        axes.plot(*(MILLIMETRES * cut[:, 1:]).T, color="#5b6675", lw=5, solid_capstyle="butt")


def draw_rays(axes: Axes, rig: Rig) -> None:
    """Rays of the middle column of the sensor, in the colours of the views that they serve."""
    labels = rig.labels()
    column = round(rig.camera.cx)
    for index in range(len(rig.views)):
        rows = np.flatnonzero(labels[:, column] == index)
        for row in rows[np.linspace(0, len(rows) - 1, 7).astype(int)] if len(rows) else ():
            path = MILLIMETRES * ray_path(rig, (column, row))
            axes.plot(path[:, 1], path[:, 2], color=view_colour(index), lw=1.1, alpha=0.85)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path, nargs="?", default=Path("docs/images/rig.svg"))
    out: Path = parser.parse_args().out
    rig = presets.ryu()
    figure = Figure(figsize=(7.5, 3.6), layout="constrained")
    axes = figure.add_subplot()
    draw_rays(axes, rig)
    draw_mirrors(axes, rig)
    centre = MILLIMETRES * rig.T_rig_cam[:3, 3]
    axes.plot(centre[1], centre[2], "o", ms=9, color="#1c2430", zorder=3)
    axes.annotate("camera", centre[1:], (95, 30), arrowprops={"arrowstyle": "-", "lw": 0.8})
    axes.set(
        aspect="equal", xlabel="front (mm)", ylabel="up (mm)", title="A cut through the rig and its rays"
    )
    axes.spines[["top", "right"]].set_visible(False)
    out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(out, metadata={"Date": None})


if __name__ == "__main__":
    main()
