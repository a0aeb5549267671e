"""Pictures and words of a rig that are made anew while a slider moves."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam.design.analysis import seen_on_horizon
from facetcam.design.areas import Area, direction_grid
from facetcam.design.cones import densify
from facetcam.rig import Rig
from facetcam.viz.palette import view_colour

Image = NDArray[np.uint8]

WIDTH = 480  # pixels of the pictures beside the sliders
_GRID = math.radians(2.0)
_BACKGROUND = 28
_STEEP = math.radians(50.0)  # of elevation that the picture of directions shows at least


def sensor_picture(rig: Rig, areas: dict[str, Area]) -> Image:
    """The raw frame with the area of each view in its colour, (H, 480, 3) red, green, blue."""
    scale = WIDTH / rig.camera.width
    picture = blank(WIDTH, round(scale * rig.camera.height))
    for index, area in enumerate(areas.values()):
        for cone in area.cones:
            pixels, valid = rig.camera.project(0.9999 * densify(cone) + 0.0001 * cone.mean(axis=0))
            if valid.sum() >= 3:
                corners = np.round(16 * ((pixels[valid] + 0.5) * scale - 0.5)).astype(np.int32)
                cv2.fillPoly(picture, [corners], rgb(view_colour(index)), cv2.LINE_8, shift=4)
    return picture


def sphere_picture(areas: dict[str, Area]) -> Image:
    """Azimuth (front in the middle) by elevation of what is seen, the horizon as a line."""
    directions, _ = direction_grid(_GRID)
    rows, columns = round(math.pi / _GRID), round(math.tau / _GRID)
    picture = blank(columns, rows)
    for index, area in enumerate(areas.values()):
        seen = area.sees(directions).reshape(rows, columns)[::-1]
        picture[seen] = rgb(view_colour(index))
    beyond = round(rows * (0.5 - _STEEP / math.pi))
    if (picture[:beyond] == _BACKGROUND).all() and (picture[-beyond:] == _BACKGROUND).all():
        picture = picture[beyond:-beyond]
    large = np.repeat(np.repeat(picture, 3, axis=0), 3, axis=1)
    large[len(large) // 2] = np.maximum(large[len(large) // 2], 120)
    return np.asarray(large, np.uint8)


def summary(rig: Rig, areas: dict[str, Area]) -> str:
    """What is seen, in a few lines of markdown."""
    centres = np.array([rig.T_rig_image(name)[:3, 3] for name in areas])
    spread = np.linalg.norm(centres[:, None] - centres[None], axis=2).max()
    sphere = sum(area.solid_angle for area in areas.values()) / (4 * math.pi)
    return (
        f"**{100 * np.mean(seen_on_horizon(areas)):.1f} %** of the horizon, **{100 * sphere:.1f} %** of all "
        f"directions; view centres up to **{1e3 * spread:.0f} mm** apart; f = **{rig.camera.fx:.0f} px**, "
        f"{rig.camera.fx * math.radians(1.0):.1f} pixels a degree"
    )


def blank(width: int, height: int) -> Image:
    """An empty dark picture."""
    return np.full((height, width, 3), _BACKGROUND, np.uint8)


def rgb(colour: str) -> tuple[int, int, int]:
    """Red, green, blue of a hex colour."""
    red, green, blue = bytes.fromhex(colour[1:])
    return red, green, blue
