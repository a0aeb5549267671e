"""Furniture: each piece stands at the origin, its back along y = 0 and its front towards -y."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from facetcam.simulation import fronts, pictures
from facetcam.simulation.materials import Colour, Material, cardboard, fabric, plain, wood
from facetcam.simulation.scene import Surface, box

Rng = np.random.Generator

OAK: Colour = (184, 136, 88)
WALNUT: Colour = (112, 74, 48)
WHITE: Colour = (228, 226, 220)


def hanging(
    rng: Rng, material: Material, width: float, height: float, thickness: float = 0.03, glow: float = 0.0
) -> list[Surface]:
    """Make something flat on a wall, its lower edge at z = 0, centred on x = 0; a window glows."""
    edge = plain((70, 56, 44))
    low, high = (-width / 2, -thickness, 0), (width / 2, 0, height)
    front, *edges = box(rng, low, high, edge, {"front": material}, ("back",))
    return [replace(front, glow=glow), *edges]


def table(rng: Rng, width: float, depth: float, height: float, colour: Colour = OAK) -> list[Surface]:
    """Make a table on four legs."""
    top = box(rng, (-width / 2, -depth, height - 0.04), (width / 2, 0, height), wood(colour), without=())
    for x in (-width / 2 + 0.04, width / 2 - 0.10):
        for y in (-depth + 0.04, -0.10):
            top += box(
                rng, (x, y, 0), (x + 0.06, y + 0.06, height - 0.04), wood(colour), without=("top", "bottom")
            )
    return top


def bookcase(
    rng: Rng, width: float, height: float, boards: int = 5, colour: Colour = WALNUT
) -> list[Surface]:
    """Make a bookcase with rows of books that stand a hand deep behind its edge."""
    depth, thick = 0.30, 0.03
    board = partial(box, rng, material=wood(colour))
    made = board((-width / 2, -depth, 0), (-width / 2 + thick, 0, height), without=("bottom", "back"))
    made += board((width / 2 - thick, -depth, 0), (width / 2, 0, height), without=("bottom", "back"))
    left, right = -width / 2 + thick, width / 2 - thick
    for z in np.linspace(0, height - thick, boards + 1):
        made += board((left, -depth, z), (right, 0, z + thick), without=("left", "right", "back"))
    step = (height - thick) / boards
    for z in np.linspace(0, height - thick, boards + 1)[:-1]:
        end = rng.uniform(0.55, 1.0) * (right - left) + left
        low, high = (
            (left, -rng.uniform(0.2, 0.26), z + thick),
            (end, 0, z + thick + step * rng.uniform(0.75, 0.88)),
        )
        made += box(
            rng, low, high, wood((214, 204, 184)), {"front": fronts.books}, ("bottom", "back", "left")
        )
    back = box(rng, (left, -0.01, 0), (right, 0, height), wood(colour), without=("back", "left", "right"))
    return made + back


def cupboard(
    rng: Rng, size: tuple[float, float, float], across: int, down: int, colour: Colour
) -> list[Surface]:
    """Make a cupboard of width, depth and height with drawers."""
    width, depth, height = size
    front = {"front": fronts.drawers(colour, across, down)}
    return box(
        rng, (-width / 2, -depth, 0), (width / 2, 0, height), wood(colour, 0.05), front, ("bottom", "back")
    )


def sofa(rng: Rng, width: float, colour: Colour) -> list[Surface]:
    """Make a sofa with arms and cushions."""
    cloth = fabric(colour)
    made = box(rng, (-width / 2, -0.85, 0.08), (width / 2, -0.2, 0.42), cloth)
    made += box(rng, (-width / 2, -0.25, 0.08), (width / 2, 0, 0.85), cloth)
    for x in (-width / 2 - 0.16, width / 2):
        made += box(rng, (x, -0.88, 0.0), (x + 0.16, 0, 0.6), cloth)
    for x in np.linspace(-width / 2 + 0.05, width / 2 - 0.5, 3):
        pattern = {"front": pictures.circles if x < 0 else pictures.mosaic}
        made += box(rng, (x, -0.36, 0.43), (x + 0.42, -0.25, 0.82), fabric((200, 180, 150)), pattern)
    return made


def chair(rng: Rng, colour: Colour = OAK) -> list[Surface]:
    """Make a chair with a slatted back."""
    made = table(rng, 0.44, 0.44, 0.46, colour)
    for x in (-0.22, 0.18):
        made += box(rng, (x, -0.04, 0.46), (x + 0.04, 0, 0.95), wood(colour))
    for z in (0.6, 0.75, 0.88):
        made += box(rng, (-0.18, -0.03, z), (0.18, -0.01, z + 0.06), wood(colour), without=("left", "right"))
    return made


def carton(rng: Rng, width: float, depth: float, height: float) -> list[Surface]:
    """Make a carton."""
    return box(rng, (-width / 2, -depth, 0), (width / 2, 0, height), cardboard())


def block(rng: Rng, width: float, depth: float, height: float, colour: Colour) -> list[Surface]:
    """Make a lacquered block, a stand-in for vases, jars and boxes."""
    return box(rng, (-width / 2, -depth, 0), (width / 2, 0, height), plain(colour))


def floor_lamp(rng: Rng, height: float = 1.5) -> list[Surface]:
    """Make the stand and bowl of a lamp that shines upwards; its light belongs a hand above."""
    made = box(rng, (-0.14, -0.28, 0), (0.14, 0, 0.03), plain((40, 40, 44)))
    made += box(rng, (-0.012, -0.152, 0.03), (0.012, -0.128, height), plain((70, 66, 60)))
    return made + box(rng, (-0.14, -0.28, height - 0.16), (0.14, 0, height), plain((236, 206, 150)))


def pendant(rng: Rng) -> list[Surface]:
    """Make the cord and shade of a lamp that hangs from z = 0; its light belongs at z = -0.25."""
    cord = box(rng, (-0.01, -0.01, -0.1), (0.01, 0.01, 0), plain((60, 56, 52)), without=("top", "bottom"))
    return cord + box(rng, (-0.17, -0.17, -0.18), (0.17, 0.17, -0.1), plain((238, 226, 200)), without=())


def monitor(rng: Rng, width: float) -> list[Surface]:
    """Make a monitor on its foot."""
    black = plain((28, 28, 30))
    height = 0.6 * width
    made = box(rng, (-0.1, -0.16, 0), (0.1, 0, 0.02), black)
    made += box(rng, (-0.03, -0.06, 0.02), (0.03, -0.03, 0.14), black)
    front = {"front": fronts.screen}
    return made + box(rng, (-width / 2, -0.1, 0.12), (width / 2, -0.06, 0.12 + height), black, front, ())
