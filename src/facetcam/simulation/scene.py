"""Scenes made of textured rectangles and lamps."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from facetcam.geometry import se3
from facetcam.simulation.materials import Material, Picture

Array = NDArray[np.float64]

# Face of a box -> the corner (share of its size in x, y, z) where the picture starts, and the picture's
# directions right and down, as someone in front of the face sees them.
_FACES: dict[str, tuple[tuple[int, int, int], tuple[int, int, int], tuple[int, int, int]]] = {
    "front": ((0, 0, 1), (1, 0, 0), (0, 0, -1)),
    "back": ((1, 1, 1), (-1, 0, 0), (0, 0, -1)),
    "right": ((1, 0, 1), (0, 1, 0), (0, 0, -1)),
    "left": ((0, 1, 1), (0, -1, 0), (0, 0, -1)),
    "top": ((0, 1, 1), (1, 0, 0), (0, -1, 0)),
    "bottom": ((0, 0, 0), (1, 0, 0), (0, 1, 0)),
}


@dataclass(frozen=True, eq=False, slots=True)
class Surface:
    """A rectangle with a picture.

    Parameters
    ----------
    corner : (3,) array
        Upper left corner of the picture in metres, world frame (z up).
    right, down : (3,) arrays
        Edges of the picture, orthogonal, in metres.
    picture : (H, W, 3) uint8 array
        RGB, covers the whole rectangle.
    glow : float
        Light that the surface sends out by itself, in units of irradiance on a white wall.
    """

    corner: Array
    right: Array
    down: Array
    picture: Picture
    glow: float = 0.0

    @property
    def size(self) -> tuple[float, float]:
        """Width and height in metres."""
        return float(np.linalg.norm(self.right)), float(np.linalg.norm(self.down))

    @property
    def normal(self) -> Array:
        """Unit normal that points to the viewer."""
        normal = np.cross(self.down, self.right)
        return normal / np.linalg.norm(normal)

    def at(self, uv: ArrayLike) -> Array:
        """Points (N, 3) of places (N, 2) on the picture, 0 to 1 from the corner."""
        uv = np.asarray(uv, dtype=np.float64).reshape(-1, 2)
        return self.corner + uv[:, :1] * self.right + uv[:, 1:] * self.down


@dataclass(frozen=True, slots=True)
class Lamp:
    """A small ball of light, or a window.

    Parameters
    ----------
    position : tuple of float
        Metres, world frame.
    power : float
        Irradiance on a surface that faces the lamp one metre away.
    colour : tuple of float
        Share of red, green and blue.
    facing : tuple of float, optional
        Unit vector into which a window shines, by Lambert's law; a ball shines everywhere.
    schedule : tuple of (time, level)
        Brightness over time in seconds, interpolated; constant before the first and after the last entry.
    """

    position: tuple[float, float, float]
    power: float
    colour: tuple[float, float, float] = (1.0, 1.0, 1.0)
    facing: tuple[float, float, float] | None = None
    schedule: tuple[tuple[float, float], ...] = ((0.0, 1.0),)

    def level(self, time: float) -> float:
        """Brightness at a time, 1 for fully on."""
        times, levels = zip(*self.schedule)
        return float(np.interp(time, times, levels))

    def switched_off(self, time: float, fade: float = 0.15) -> Lamp:
        """Return this lamp going off at a time, within `fade` seconds."""
        return replace(self, schedule=((time, 1.0), (time + fade, 0.0)))


@dataclass(frozen=True, eq=False, slots=True)
class Scene:
    """Surfaces and lamps of a closed room."""

    surfaces: tuple[Surface, ...]
    lamps: tuple[Lamp, ...]


def box(
    rng: np.random.Generator,
    low: ArrayLike,
    high: ArrayLike,
    material: Material,
    faces: Mapping[str, Material] | None = None,
    without: Iterable[str] = ("bottom",),
) -> list[Surface]:
    """Make the faces of a box.

    Parameters
    ----------
    low, high : (3,) arrays
        Opposite corners in metres; x to the right, y to the back, z up.
    material : callable
        Paints every face that `faces` (front, back, left, right, top, bottom) does not paint.
    without : iterable of str
        Faces that nobody sees.
    """
    low, high = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    painters = dict.fromkeys(_FACES, material) | dict(faces or {})
    made = []
    hidden = set(without)
    for name in (n for n in painters if n not in hidden):
        start, right, down = (np.array(v) for v in _FACES[name])
        along, across = right * (high - low), down * (high - low)
        picture = painters[name](rng, float(np.linalg.norm(along)), float(np.linalg.norm(across)))
        made.append(Surface(low + start * (high - low), along, across, picture))
    return made


def placed(surfaces: Iterable[Surface], x: float, y: float, yaw: float, z: float = 0.0) -> list[Surface]:
    """Move surfaces to (x, y, z) after a turn by `yaw` radians about the vertical."""
    T = se3.exp([0.0, 0.0, yaw, 0.0, 0.0, 0.0])
    T[:3, 3] = (x, y, z)
    R = T[:3, :3]
    return [
        replace(s, corner=se3.transform(T, [s.corner])[0], right=R @ s.right, down=R @ s.down)
        for s in surfaces
    ]
