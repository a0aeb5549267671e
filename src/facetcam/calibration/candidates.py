"""In which views a sighting may have been seen, by its handedness and its place on the sensor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam.calibration.readings import Reading
from facetcam.calibration.sightings import Sighting
from facetcam.rig import Rig

Array = NDArray[np.float64]

_ASTRAY = 0.13  # radians by which mirrors off the drawing may displace a view on the sensor
_SURE = 6.0  # growth of the odds of a view with the depth inside it
_STEP = 4  # pixels between samples of the map of views


@dataclass(frozen=True, eq=False)
class Candidate:
    """A view in which a sighting may have been seen.

    `depth` says how far inside the view, as drawn, it lies; negative outside. `T_rig_board` is the
    pose of its board if it was seen there, its corners named as in `sighting`.
    """

    view: int
    depth: float
    T_rig_board: Array
    sighting: Sighting

    @property
    def weight(self) -> float:
        """How likely the place on the sensor makes it, against other views."""
        return float(1.0 / (1.0 + np.exp(-_SURE * self.depth)))


class ViewDepths:
    """How far inside each view pixels lie.

    Parameters
    ----------
    rig : Rig
    views : sequence of str
    """

    def __init__(self, rig: Rig, views: Sequence[str]) -> None:
        # Unbounded mirrors without regions share all their pixels: where views end is then not known.
        self.bounded = all(m.polygon is not None for m in rig.mirrors.values())
        self._rig, self._views = rig, tuple(views)

    @cached_property
    def _maps(self) -> list[Array]:
        """Depth at every `_STEP`th pixel, a view each."""
        labels = self._rig.labels()[::_STEP, ::_STEP]
        maps = []
        for view in self._views:
            own = np.pad((labels == self._rig.view_names.index(view)).astype(np.uint8), 1)
            inside, outside = (cv2.distanceTransform(m, cv2.DIST_L2, 5)[1:-1, 1:-1] for m in (own, 1 - own))
            far = float(max(labels.shape))  # where a view has no pixel at all
            maps.append(_STEP * np.where(own[1:-1, 1:-1] > 0, inside, -np.minimum(outside, far)))
        return maps

    def at(self, view: int, pixels: Array) -> Array:
        """Pixels (N,) from the edge of the view, positive inside, of raw-frame pixels (N, 2)."""
        limits = np.array(self._maps[view].shape[::-1]) - 1
        u, v = np.clip(np.rint(pixels / _STEP), 0, limits).astype(np.int64).T
        return np.asarray(self._maps[view][v, u], dtype=np.float64)


def candidates_of(
    rig: Rig, views: Sequence[str], depths: ViewDepths, readings: Sequence[Reading]
) -> list[Candidate]:
    """Views of the right handedness near which a sighting lies, likeliest first, each with each reading."""
    reach = _ASTRAY * max(rig.camera.fx, rig.camera.fy)
    found = []
    for r in readings:
        for index, name in enumerate(views):
            if rig.is_flipped(name) != r.mirrored or r.sighting.view not in (None, name):
                continue
            known = r.sighting.view == name
            depth = np.inf if known else float(np.median(depths.at(index, r.sighting.pixels)) / reach)
            if depth > -1.0:
                sure = depth if known else min(depth, 1.0)
                found.append(Candidate(index, sure, rig.T_rig_image(name) @ r.T_image_board, r.sighting))
    return sorted(found, key=lambda c: -c.depth)
