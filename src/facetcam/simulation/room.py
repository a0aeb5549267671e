"""The built-in scene: a furnished living room of 6 x 5 x 2.6 metres."""

from __future__ import annotations

from math import pi

import numpy as np

from facetcam.simulation import fronts, pictures
from facetcam.simulation import furniture as made
from facetcam.simulation.materials import (
    Material,
    bricks,
    floor_boards,
    plain,
    plaster,
    rug,
    wallpaper,
    wood,
)
from facetcam.simulation.scene import Lamp, Scene, Surface, box, placed

Rng = np.random.Generator

LENGTH, WIDTH, HEIGHT = 6.0, 5.0, 2.6  # metres along x, y, z; the origin is on the floor, in the middle

# Where to stand with one's back to a wall: (x, y, yaw) from the distance along the wall.
NORTH, SOUTH = (0.0, WIDTH / 2, 0.0), (0.0, -WIDTH / 2, pi)
EAST, WEST = (LENGTH / 2, 0.0, -pi / 2), (-LENGTH / 2, 0.0, pi / 2)

PENDANTS = ((-1.5, 0.2), (1.5, -0.2))
LAMP_OFF_AT = 6.0  # seconds

_ALL_BUT_FRONT = ("back", "left", "right", "top", "bottom")
_ALL_BUT_TOP = ("front", "back", "left", "right", "bottom")
_ALL_BUT_BOTTOM = ("front", "back", "left", "right", "top")


def furnished_room(seed: int = 7) -> Scene:
    """Make the room; the same seed gives the same room."""
    rng = np.random.default_rng(seed)
    surfaces = [*_shell(rng), *_north(rng), *_east(rng), *_south(rng), *_west(rng), *_middle(rng)]
    return Scene(tuple(surfaces), _lamps())


def _lamps() -> tuple[Lamp, ...]:
    warm, day = (1.0, 0.9, 0.76), (0.92, 0.97, 1.05)
    lasting, failing = (Lamp((x, y, HEIGHT - 0.25), 1.5, warm) for x, y in PENDANTS)
    return (
        lasting,
        failing.switched_off(LAMP_OFF_AT),
        Lamp((-1.3, 2.4, 1.55), 2.2, day, facing=(0.0, -1.0, 0.0)),
        Lamp((2.86, -2.1, 1.66), 0.35, warm),
    )


def _against(
    wall: tuple[float, float, float], along: float, surfaces: list[Surface], z: float = 0.0
) -> list[Surface]:
    """Put a piece with its back to a wall, `along` metres to the right of the wall's middle."""
    x, y, yaw = wall
    return placed(surfaces, x + along * np.cos(yaw), y + along * np.sin(yaw), yaw, z)


def _shell(rng: Rng) -> list[Surface]:
    cream, white = (222, 214, 196), (236, 235, 230)
    walls: tuple[tuple[tuple[float, float, float], float, Material], ...] = (
        (NORTH, LENGTH, plaster(cream)),
        (EAST, WIDTH, plaster((200, 212, 214))),
        (SOUTH, LENGTH, wallpaper((216, 208, 190), (204, 194, 172))),
        (WEST, WIDTH, bricks((160, 92, 70))),
    )
    surfaces = []
    for wall, length, material in walls:
        panel = box(rng, (-length / 2, 0, 0), (length / 2, 0.1, HEIGHT), material, without=_ALL_BUT_FRONT)
        skirting = box(
            rng, (-length / 2, -0.015, 0), (length / 2, 0, 0.09), plain(made.WHITE), without=("back",)
        )
        surfaces += _against(wall, 0.0, panel + skirting)
    half = np.array([LENGTH / 2, WIDTH / 2, 0.1])
    floor = box(rng, -half, half * (1, 1, 0), floor_boards((170, 122, 76)), without=_ALL_BUT_TOP)
    ceiling = box(rng, -half * (1, 1, 0), half, plaster(white, 0.004), without=_ALL_BUT_BOTTOM)
    return surfaces + floor + placed(ceiling, 0, 0, 0, HEIGHT) + _beams(rng)


def _beams(rng: Rng) -> list[Surface]:
    surfaces: list[Surface] = []
    for x in (-2.0, 0.0, 2.0):
        low, high = (x - 0.07, -WIDTH / 2, HEIGHT - 0.14), (x + 0.07, WIDTH / 2, HEIGHT)
        surfaces += box(rng, low, high, wood(made.WALNUT), without=("front", "back", "top"))
    return surfaces


def _north(rng: Rng) -> list[Surface]:
    art = pictures.framed(pictures.mosaic, (60, 44, 32))
    return [
        *_against(NORTH, -1.3, made.hanging(rng, fronts.window, 1.5, 1.2, 0.04, glow=0.5), 0.95),
        *_against(NORTH, -1.3, made.hanging(rng, fronts.radiator, 1.2, 0.55, 0.1), 0.12),
        *_against(NORTH, 1.0, made.bookcase(rng, 1.3, 2.0)),
        *_against(NORTH, 2.3, made.hanging(rng, art, 0.62, 0.8), 1.15),
        *_against(NORTH, 2.4, made.carton(rng, 0.5, 0.4, 0.36)),
        *_against(NORTH, 2.45, made.carton(rng, 0.34, 0.3, 0.26), 0.36),
        *_against(NORTH, -2.55, made.hanging(rng, pictures.calendar, 0.42, 0.6, 0.005), 1.25),
        *_against(
            NORTH, 0.0, made.hanging(rng, pictures.framed(pictures.circles, (180, 150, 90)), 0.4, 0.4), 1.5
        ),
    ]


def _east(rng: Rng) -> list[Surface]:
    scenery = pictures.framed(pictures.landscape, (96, 66, 40))
    return [
        *_against(EAST, 1.4, made.hanging(rng, fronts.door, 0.95, 2.08, 0.04)),
        *_against(EAST, -0.6, made.cupboard(rng, (1.7, 0.45, 0.78), 3, 3, (206, 196, 176))),
        *_against(EAST, -0.6, made.monitor(rng, 0.85), 0.78),
        *_against(EAST, -1.25, made.block(rng, 0.16, 0.2, 0.3, (40, 96, 130)), 0.78),
        *_against(EAST, 0.08, made.carton(rng, 0.22, 0.2, 0.18), 0.78),
        *_against(EAST, -0.6, made.hanging(rng, scenery, 1.1, 0.62), 1.68),
        *_against(
            EAST, -2.0, made.hanging(rng, pictures.framed(pictures.skyline, (30, 30, 34)), 0.6, 0.85), 1.1
        ),
        *_against(EAST, 2.1, made.floor_lamp(rng)),
        *_against(EAST, 0.55, made.hanging(rng, fronts.clock, 0.3, 0.3), 1.75),
    ]


def _south(rng: Rng) -> list[Surface]:
    shelf = box(rng, (-0.6, -0.24, 0), (0.6, 0, 0.03), wood(made.OAK), without=("back",))
    row = box(rng, (-0.55, -0.18, 0), (0.2, 0, 0.26), wood((214, 204, 184)), {"front": fronts.books})
    surfaces = [
        *_against(SOUTH, 0.9, made.sofa(rng, 1.9, (78, 104, 112))),
        *_against(SOUTH, -1.1, shelf, 1.4),
        *_against(SOUTH, -1.1, row, 1.43),
        *_against(SOUTH, -1.45, made.block(rng, 0.14, 0.15, 0.22, (186, 70, 50)), 1.43),
        *_against(SOUTH, -1.1, made.cupboard(rng, (1.0, 0.4, 0.7), 2, 2, (122, 150, 138))),
        *_against(SOUTH, -0.85, made.carton(rng, 0.36, 0.3, 0.24), 0.7),
        *_against(SOUTH, -1.35, made.block(rng, 0.2, 0.2, 0.14, (226, 180, 60)), 0.7),
    ]
    for along, picture in ((0.2, pictures.circles), (0.9, pictures.skyline), (1.6, pictures.landscape)):
        art = pictures.framed(picture, (44, 40, 38), mat=0.04)
        surfaces += _against(SOUTH, along, made.hanging(rng, art, 0.55, 0.7), 1.15)
    return surfaces


def _west(rng: Rng) -> list[Surface]:
    seat = placed(made.chair(rng), -1.95, -0.2, -1.3)
    return [
        *_against(WEST, -0.4, made.table(rng, 1.5, 0.7, 0.74)),
        *_against(WEST, -0.55, made.monitor(rng, 0.6), 0.74),
        *_against(WEST, 0.1, made.carton(rng, 0.3, 0.26, 0.2), 0.74),
        *_against(WEST, -1.0, made.block(rng, 0.1, 0.14, 0.12, (60, 130, 96)), 0.74),
        *_against(WEST, -0.45, made.hanging(rng, pictures.notes, 1.2, 0.75, 0.02), 1.45),
        *_against(WEST, 1.5, made.bookcase(rng, 0.9, 1.8, 4, made.OAK)),
        *_against(
            WEST, -1.9, made.hanging(rng, pictures.framed(pictures.mosaic, (40, 40, 44)), 0.7, 0.9), 1.1
        ),
        *seat,
    ]


def _middle(rng: Rng) -> list[Surface]:
    carpet = rug(((142, 46, 42), (224, 206, 170), (44, 62, 96), (190, 120, 60), (60, 92, 84)))
    mat = box(rng, (-1.5, -0.9, 0), (1.5, 0.9, 0.012), carpet)
    lamps = [s for x, y in PENDANTS for s in placed(made.pendant(rng), x, y, 0.0, HEIGHT)]
    return [
        *mat,
        *lamps,
        *placed(made.table(rng, 0.9, 0.5, 0.42, made.WALNUT), 0.05, 0.25, 0.15),
        *placed(made.carton(rng, 0.26, 0.2, 0.07), -0.1, 0.1, 0.5, 0.42),
        *placed(made.block(rng, 0.12, 0.12, 0.16, (46, 110, 120)), 0.25, 0.05, 0.9, 0.42),
    ]
