"""A rig as a drawing: in space and from two sides, with its rays and sizes."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from facetcam.design.analysis import Analysis
from facetcam.design.spec import Body, Family
from facetcam.design.unfolding import body_faces
from facetcam.geometry import se3
from facetcam.rig import Rig
from facetcam.rig.tracing import Tracer
from facetcam.viz.figures import CARD, ERROR_COLOUR, INK, MUTED, new_figure, to_svg
from facetcam.viz.palette import view_colour
from facetcam.viz.space import empty_space, frame_axes, on_page

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

MM = 1000.0
MIRROR_COLOUR, BODY_COLOUR = "#8a94a3", "#4a5362"
_BOUNCES = 6
_ALONE = 0.2  # metres
_RAYS = 5  # drawn of each view
_STRAY_LINES = ("-", "--", ":")  # of the parasitic paths drawn
_LETTER, _LINE = 0.085, 0.19  # inches of a name, bold at 10 points
_BOX = np.stack(np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 5)), axis=-1).reshape(-1, 2)
_PAPER = {"facecolor": CARD, "alpha": 0.85, "edgecolor": "none", "pad": 1.0}  # under words amid rays


def rig_figure(analysis: Analysis, body: Body, height: float = 5.6) -> str:
    """The rig in space, at most `height` inches high: mirrors, camera, rays; circles are virtual cameras."""
    rig = analysis.rig
    figure, axes = empty_space(7.2, height)
    shown = [_draw_solids(axes, rig, body)]
    size, drawn = _size(rig), dict[str, list[Array]]()
    for index, name in enumerate(rig.views):
        colour = view_colour(index)
        paths = [ray_path(rig, ray, 0.55 * size) for ray in _spread_rays(analysis, name)]
        for path in paths:
            axes.plot(*(MM * path).T, color=colour, lw=1.1, alpha=0.9)
        shown += paths
        drawn[name] = paths
        centre = MM * analysis.views[name].centre
        axes.plot(*centre[:, None], "o", ms=6, mfc="none", mec=colour, mew=1.6)
        shown.append(centre[None] / MM)
    frame_axes(axes, MM * np.vstack(shown))
    _name_views(axes, drawn)
    return to_svg(figure)


def stray_figure(analysis: Analysis, body: Body) -> str:
    """The parasitic paths of the largest shares in space: the ray of the pixel deepest within each."""
    rig, sensor = analysis.rig, analysis.sensor
    figure, axes = empty_space(6.4, 4.4)
    shown = [_draw_solids(axes, rig, body)]
    size = _size(rig)
    for style, (words, pixel) in zip(_STRAY_LINES, sensor.amid.items()):
        path = ray_path(rig, rig.camera.ray(pixel[None])[0], 0.8 * size)
        label = f"{words} ({100 * sensor.parasites[words]:.1f} %)"
        axes.plot(*(MM * path).T, style, color=ERROR_COLOUR, lw=1.6, label=label)
        shown.append(path)
    frame_axes(axes, MM * np.vstack(shown))
    figure.legend(loc="upper left", frameon=False, labelcolor=INK, fontsize=9)
    return to_svg(figure)


def side_figure(analysis: Analysis, family: Family | None, across: int) -> str:
    """The rig from the side (`across` = 1) or the front (0), with its rays and the sizes of the drawing.

    The rays are those of the middle column or row of the sensor; where these show too little (a camera that
    stands askew), some of each view.
    """
    rig = analysis.rig
    figure, axes = new_figure(5.8, 4.0)
    size = _size(rig)
    for index, name in enumerate(rig.views):
        rays = _middle_rays(analysis, index, across) if family is not None else _spread_rays(analysis, name)
        for ray in rays:
            path = MM * ray_path(rig, ray, 0.5 * size)
            axes.plot(path[:, across], path[:, 2], color=view_colour(index), lw=1.0, alpha=0.75)
    for mirror in rig.mirrors.values():
        if mirror.polygon is not None:
            ring = MM * np.vstack([mirror.polygon, mirror.polygon[:1]])
            axes.fill(ring[:, across], ring[:, 2], color=MIRROR_COLOUR, alpha=0.13, lw=0)
            axes.plot(ring[:, across], ring[:, 2], color=INK, lw=1.3)
    axes.plot(MM * rig.T_rig_cam[across, 3], MM * rig.T_rig_cam[2, 3], "o", ms=7, color=INK)
    if family is not None:
        _dimensions(axes, family, across)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel(f"{('right', 'front')[across]} (mm)")
    axes.set_ylabel("up (mm)")
    return to_svg(figure)


def ray_path(rig: Rig, ray: Array, beyond: float) -> Array:
    """Corner points (N, 3) of a camera ray (3,), from the lens over every mirror and `beyond` metres on."""
    mirrors = list(rig.mirrors.values())
    paths = Tracer(mirrors, rig.T_rig_cam).trace(ray[None], _BOUNCES)
    corners, direction, travelled = [rig.T_rig_cam[:3, 3]], rig.T_rig_cam[:3, :3] @ ray, 0.0
    for index, length in zip(paths.mirror[:, 0], paths.length[:, 0], strict=True):
        if index < 0:
            break
        corners.append(corners[-1] + (length - travelled) * direction)
        direction, travelled = mirrors[index].reflection[:3, :3] @ direction, length
    return np.array([*corners, corners[-1] + beyond * direction])


def _spread_rays(analysis: Analysis, name: str) -> list[Array]:
    """A ray (3,) amid a view and up to four near its corners, far from each other."""
    area = analysis.areas[name]
    middle = np.mean([cone.mean(axis=0) for cone in area.cones], axis=0)
    corners = np.vstack(area.outlines())
    inner = middle + 0.94 * (corners - middle)
    inner /= np.linalg.norm(inner, axis=1, keepdims=True)
    inner = inner[area.sees(inner @ area.R.T)]
    chosen = [middle / np.linalg.norm(middle)]
    while len(chosen) < min(_RAYS, len(inner) + 1):
        gaps = np.linalg.norm(inner[:, None] - np.array(chosen)[None], axis=2).min(axis=1)
        chosen.append(inner[int(np.argmax(gaps))])
    return [ray for ray in chosen if area.sees((ray @ area.R.T)[None])[0]]


def _middle_rays(analysis: Analysis, index: int, across: int) -> Array:
    """Rays (N, 3) of a view on the middle column (across = 1) or row (0) of the sensor."""
    camera, sensor = analysis.rig.camera, analysis.sensor
    column, row = (round(c / sensor.step) for c in (camera.cx, camera.cy))
    line = sensor.view[:, column] if across == 1 else sensor.view[row]
    found = np.flatnonzero(line == index)
    if not len(found):
        return np.empty((0, 3))
    along = sensor.step * found[np.linspace(0, len(found) - 1, 7).astype(int)].astype(np.float64)
    other = np.full(len(along), camera.cx if across == 1 else camera.cy)
    return camera.ray(np.column_stack([other, along] if across == 1 else [along, other]))


def _draw_solids(axes: Any, rig: Rig, body: Body) -> Array:
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    chains = sorted(enumerate(view.mirrors for view in rig.views.values()), key=lambda c: -len(c[1]))
    last = {chain[-1]: i for i, chain in chains if chain}  # of the shortest chain, where several end alike
    drawn = []
    for name, mirror in rig.mirrors.items():
        if mirror.polygon is not None:
            colour = view_colour(last[name]) if name in last else MIRROR_COLOUR
            face = Poly3DCollection(
                [MM * mirror.polygon], facecolor=colour, alpha=0.22, edgecolor=colour, lw=1.2
            )
            axes.add_collection3d(face)
            drawn.append(mirror.polygon)
    faces = [se3.transform(rig.T_rig_cam, face) for face in body_faces(body)]
    solid = Poly3DCollection(
        [MM * face for face in faces], facecolor=BODY_COLOUR, alpha=0.9, edgecolor="none"
    )
    axes.add_collection3d(solid)
    return np.vstack([*drawn, *faces])


def _name_views(axes: Any, paths: dict[str, list[Array]]) -> None:
    """Write each name beyond the end of one of the view's rays (N, 3), where it hides least."""
    inked = np.vstack([on_page(axes, MM * _dense(path)) for rays in paths.values() for path in rays])
    box = axes.get_position()
    inch = 1.0 / (box.width * axes.figure.get_size_inches()[0])  # on the page that the places are told in
    page = (np.array([[0.0, 0.0], [1.0, 1.0]]) - (box.x0, box.y0)) / (box.width, box.height)
    for index, (name, rays) in enumerate(paths.items()):
        half = inch / 2 * np.array([_LETTER * (len(name) + 1), _LINE])
        tips, before = (on_page(axes, MM * np.array([path[i] for path in rays])) for i in (-1, -2))
        ahead = (tips - before) / np.maximum(np.linalg.norm(tips - before, axis=1, keepdims=True), 1e-9)
        middles = np.clip(tips + 1.05 * half * ahead, page[0] + half, page[1] - half)
        away = (np.abs(inked[None] - middles[:, None]) / half).max(axis=2)
        chosen = max(range(len(rays)), key=lambda i: (-(away[i] < 1).sum(), away[i].min()))
        inked = np.vstack([inked, middles[chosen] + half * _BOX])
        axes.text2D(
            *middles[chosen], name, transform=axes.transAxes, color=view_colour(index), fontsize=10,
            fontweight="bold", ha="center", va="center", bbox=_PAPER, zorder=20,
        )  # fmt: skip


def _dense(path: Array) -> Array:
    """Points along a path (N, 3), close enough to tell what a word on it would hide."""
    steps = np.linspace(0.0, 1.0, 60)[:, None]
    return np.vstack([start + steps * (end - start) for start, end in pairwise(path)])


def _dimensions(axes: Axes, family: Family, across: int) -> None:
    """Height, and radius and tilt where a facet is seen edge-on: to the right only of 4, 8, ... faces."""
    stretch = family.aspect if across == 0 and family.faces % 2 == 0 else 1.0
    radius = MM * family.radius * stretch
    words_of = "radius" if stretch == 1.0 else "radius × aspect"
    wide = MM * family.height if family.fold else 0.0
    up = 1.0 if family.fold else -1.0
    room = 0.10 * MM * family.height * up

    def measure(
        start: tuple[float, float], end: tuple[float, float], words: str, at: tuple[float, float]
    ) -> None:
        axes.annotate("", start, end, arrowprops={"arrowstyle": "<->", "color": MUTED, "lw": 0.9})
        axes.annotate(words, at, color=INK, ha="center", va="center", fontsize=9)

    outside = axes.dataLim.x0 - 0.12 * MM * family.height  # where no ray crosses the words
    axes.update_datalim([(outside - 0.3 * MM * family.height, 0.0)])
    axes.autoscale_view()
    measure((outside, 0), (outside, MM * family.height), "", (0, 0))
    words, middle = f"height {MM * family.height:.0f}", MM * family.height / 2
    axes.annotate(
        words,
        (outside - 0.4 * abs(room), middle),
        color=INK,
        rotation=90,
        ha="right",
        va="center",
        fontsize=9,
    )
    if across == 0 and family.faces % 4:
        return
    measure(
        (0, wide + room), (radius, wide + room), f"{words_of} {radius:.1f}", (radius / 2, wide + 1.9 * room)
    )
    tilt = f"tilt {family.tilt_degrees:.1f}°"
    axes.annotate(tilt, (0.62 * radius, wide - 0.8 * room), color=INK, ha="right", va="center", fontsize=9)


def _size(rig: Rig) -> float:
    """Metres across lens and bounded mirrors; a camera without any is given room for its rays."""
    polygons = [m.polygon for m in rig.mirrors.values() if m.polygon is not None]
    corners = np.vstack([rig.T_rig_cam[None, :3, 3], *polygons])
    return float(np.ptp(corners, axis=0).max()) if polygons else _ALONE
