"""The mirrors as the camera sees them: projected onto its sensor, and under other lenses and orientations."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from facetcam.design.cones import clip
from facetcam.geometry import se3
from facetcam.rig import Camera, Rig
from facetcam.viz.figures import INK, MUTED, plain, to_svg
from facetcam.viz.palette import view_colour
from facetcam.viz.rig_figures import MIRROR_COLOUR, MM
from facetcam.viz.space import frame_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

SENSOR_COLOUR, IMAGE_COLOUR = "#2f81f7", "#1aa179"
_NEAREST = 1e-4  # metres before the lens at which polygons are cut off


def projection_figure(rig: Rig, target: Array, optimum: float) -> str:
    """How the first mirror projects through the lens onto the sensor, drawn before the lens and enlarged."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.6, 4.6), facecolor="none")
    space: Any = figure.add_axes((0.0, 0.0, 0.5, 1.0), projection="3d", facecolor="none")
    flat = figure.add_axes((0.58, 0.14, 0.4, 0.74), facecolor="none")
    _project_in_space(space, rig, target)
    plain(flat)
    camera = rig.camera
    sensor = sensor_outline(camera)
    flat.plot(*sensor.T, color=INK, lw=1.5, label="sensor")
    labels = [(rig.camera.fx, "#2f81f7", "-"), (optimum, "#1aa179", "--")]
    for focal, colour, style in labels:
        for k, ring in enumerate(_first_rings(rig)):
            pixels = project_polygon(with_focal(camera, focal), rig.T_rig_cam, ring)
            words = f"first mirror at f = {focal:.0f} px" if k == 0 else None
            flat.plot(*pixels.T, color=colour, ls=style, lw=1.6, label=words)
    flat.set_aspect("equal")
    flat.invert_yaxis()
    flat.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=3, frameon=False, labelcolor=INK, fontsize=8)
    flat.set_xlabel("pixels")
    return to_svg(figure)


def variation_figure(rig: Rig) -> str:
    """How the image of the mirrors changes with focal length (columns) and orientation (rows)."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.6, 7.0), layout="constrained", facecolor="none")
    grid = figure.subplots(3, 3, sharex=True, sharey=True)
    camera = rig.camera
    for row, tilt in zip(grid, (0.0, 8.0, 16.0)):
        for axes, scale in zip(row, (0.8, 1.0, 1.25)):
            axes.set_facecolor("none")
            plain(axes)
            axes.grid(visible=False)
            turn = math.radians(tilt)
            R = np.array(
                [(1, 0, 0), (0, math.cos(turn), -math.sin(turn)), (0, math.sin(turn), math.cos(turn))]
            )
            T = rig.T_rig_cam @ se3.from_rotation_translation(R, np.zeros(3))
            _draw_image_of_mirrors(axes, rig, with_focal(camera, scale * camera.fx), T)
            axes.plot(*sensor_outline(camera).T, color=INK, lw=1.5)
            axes.set_title(f"f = {scale * camera.fx:.0f} px, turned {tilt:.0f}°", fontsize=9, color=MUTED)
            axes.set_xlim(-0.35 * camera.width, 1.35 * camera.width)
            axes.set_ylim(1.35 * camera.height, -0.35 * camera.height)
            axes.set_aspect("equal")
            axes.set_xticks([])
            axes.set_yticks([])
    return to_svg(figure)


def project_polygon(camera: Camera, T_rig_cam: Array, polygon: Array) -> Array:
    """Pixels (N, 2) of a polygon's closed outline, bent by the lens; they may lie off the sensor."""
    inside = se3.transform(se3.inverse(T_rig_cam), polygon)
    before = clip(np.column_stack([inside, np.ones(len(inside))]), np.array([0.0, 0.0, 1.0, -_NEAREST]))[
        :, :3
    ]
    if len(before) < 3:
        return np.empty((0, 2))
    shares = np.linspace(0.0, 1.0, 24, endpoint=False)[:, None]
    dense = np.vstack([a + shares * (b - a) for a, b in zip(before, np.roll(before, -1, axis=0))])
    margin = min(4 * camera.width, (16384 - camera.width) // 2, (16384 - camera.height) // 2)
    wide = replace(
        camera, width=camera.width + 2 * margin, height=camera.height + 2 * margin,
        cx=camera.cx + margin, cy=camera.cy + margin,
    )  # fmt: skip
    pixels, valid = wide.project(np.vstack([dense, dense[:1]]))
    pixels[~valid] = np.nan
    shifted: Array = pixels - margin
    return shifted


def with_focal(camera: Camera, focal: float) -> Camera:
    """The camera with another fx, and fy in proportion."""
    return replace(camera, fx=focal, fy=focal * camera.fy / camera.fx)


def _project_in_space(axes: Any, rig: Rig, target: Array) -> None:
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    axes.set_axis_off()
    axes.view_init(elev=16, azim=-58)
    centre = rig.T_rig_cam[:3, 3]
    rays = rig.camera.ray(sensor_outline(rig.camera)[:4])
    reach = 0.45 * float(np.median((target - centre) @ rig.T_rig_cam[:3, 2]))
    frame = se3.transform(rig.T_rig_cam, reach * rays / np.maximum(rays[:, 2:], 0.2))

    def fill(ring: Array, colour: str, alpha: float) -> None:
        face = Poly3DCollection([MM * ring], facecolor=colour, alpha=alpha, edgecolor=colour, lw=1.4)
        axes.add_collection3d(face)

    fill(frame, SENSOR_COLOUR, 0.12)
    for ring in _first_rings(rig):
        fill(ring, MIRROR_COLOUR, 0.25)
        shares = reach / np.maximum((ring - centre) @ rig.T_rig_cam[:3, 2], 1e-6)
        image = centre + shares[:, None] * (ring - centre)
        fill(image, IMAGE_COLOUR, 0.35)
        for corner in ring:
            axes.plot(*(MM * np.stack([centre, corner], axis=1)), color=MUTED, lw=0.8)
    axes.plot(*(MM * centre)[:, None], "o", color=INK, ms=6)
    axes.text(*(MM * centre), 3 * "\N{NO-BREAK SPACE}" + "lens", color=INK, fontsize=9, va="bottom")
    frame_axes(axes, MM * np.vstack([centre[None], target, frame]), box=(0.0, 0.0, 5.8, 4.6))


def _first_rings(rig: Rig) -> list[Array]:
    names = dict.fromkeys(view.mirrors[0] for view in rig.views.values() if view.mirrors)
    polygons = (rig.mirrors[name].polygon for name in names)
    return [polygon for polygon in polygons if polygon is not None]


def _draw_image_of_mirrors(axes: Axes, rig: Rig, camera: Camera, T_rig_cam: Array) -> None:
    for ring in _first_rings(rig):
        pixels = project_polygon(camera, T_rig_cam, ring)
        axes.fill(*pixels.T, color=MIRROR_COLOUR, alpha=0.22, lw=0)
        axes.plot(*pixels.T, color=MIRROR_COLOUR, lw=1.2)
    for index, view in enumerate(rig.views.values()):
        if len(view.mirrors) < 2:
            continue
        polygon, T = rig.mirrors[view.mirrors[-1]].polygon, T_rig_cam
        for name in view.mirrors[:-1]:
            T = rig.mirrors[name].reflection @ T
        if polygon is not None:
            pixels = project_polygon(camera, T, polygon)
            axes.fill(*pixels.T, color=view_colour(index), alpha=0.30, lw=0)
            axes.plot(*pixels.T, color=view_colour(index), lw=1.2)


def sensor_outline(camera: Camera) -> Array:
    right, bottom = camera.width - 0.5, camera.height - 0.5
    return np.array([(-0.5, -0.5), (right, -0.5), (right, bottom), (-0.5, bottom), (-0.5, -0.5)])
