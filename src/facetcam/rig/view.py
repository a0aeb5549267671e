"""Views: which mirrors a camera ray meets, and where on the sensor."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from facetcam.config import nearest
from facetcam.errors import RigError

Array = NDArray[np.float64]

MOST = 127  # views or mirrors: labels and paths are int8


@dataclass(frozen=True, eq=False)
class View:
    """One chain of mirrors, in the order in which a camera ray meets them; empty for the direct view.

    `region` (N, 2), optional, bounds the view on the sensor in pixels.
    """

    mirrors: tuple[str, ...] = ()
    region: Array | None = None

    def covers(self, pixels: Array) -> NDArray[np.bool_]:
        """Tell which pixels (N, 2) lie in the region."""
        if self.region is None:
            return np.ones(len(pixels), dtype=bool)
        return inside_polygon(self.region, pixels)


def inside_polygon(polygon: Array, points: Array) -> NDArray[np.bool_]:
    """Tell which points (N, 2) lie inside a simple polygon (M, 2), by counting crossings to the right."""
    inside = np.zeros(len(points), dtype=bool)
    x, y = points.T
    for (x0, y0), (x1, y1) in zip(polygon, np.roll(polygon, -1, axis=0)):
        if y0 != y1:
            spans = (y0 <= y) != (y1 <= y)
            inside ^= spans & (x < x0 + (y - y0) * (x1 - x0) / (y1 - y0))
    return inside


def check_views(mirrors: Iterable[str], views: Mapping[str, View]) -> None:
    """Raise RigError on a view whose name, chain or region cannot be used."""
    known = list(mirrors)
    if not 1 <= len(views) <= MOST or len(known) > MOST:
        raise RigError(f"views: a rig takes 1 to {MOST} views and up to {MOST} mirrors")
    for name, view in views.items():
        # The name becomes a folder.
        if not re.fullmatch(r"\w[\w.-]*", name):
            raise RigError(f"view '{name}': name it with letters, digits, '_', '-' and '.'")
        for mirror in view.mirrors:
            if mirror not in known:
                hint = nearest(mirror, known) if known else "the rig has none"
                raise RigError(f"view '{name}': no mirror '{mirror}' in the rig; {hint}")
        if view.region is not None:
            _check_region(name, np.asarray(view.region))


def _check_region(name: str, region: Array) -> None:
    if region.ndim != 2 or region.shape[1] != 2 or len(region) < 3 or not np.all(np.isfinite(region)):
        raise RigError(f"view '{name}': region takes three or more finite pixels [u, v]")
    x, y = region.T
    if abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) < 2.0:
        raise RigError(
            f"view '{name}': region has less than one pixel of area; give corners in order round it"
        )
