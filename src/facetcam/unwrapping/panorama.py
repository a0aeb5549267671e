"""All views on one picture round the rig, with the holes between them drawn as holes."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from facetcam.errors import ConfigError
from facetcam.rig import Rig
from facetcam.unwrapping.resampler import Image, Resampler
from facetcam.unwrapping.unwrapper import SEAM_MARGIN, UsablePixels
from facetcam.unwrapping.views import seen_directions

Array = NDArray[np.float64]

_HATCH = 16  # pixels between the stripes in holes
_STEEPEST = math.radians(80.0)  # a cylinder has no end above this


class Panorama:
    """A panorama about the rig's z axis; the front (+y) is in the middle, the right to the right.

    The views of a mirror rig have different centres, and between convex facets there are directions that
    none sees. So a panorama is right at one depth only, and its holes are hatched, not painted over.

    Parameters
    ----------
    rig : Rig
    depth : float
        Metres from the mean of the view centres at which neighbouring views join.
    width : int
        Pixels round the full turn.
    projection : {"equirectangular", "cylindrical"}
        Rows are equal steps of elevation, or of its tangent.
    margin : float
        Pixels of the raw frame left out along seams.

    Raises
    ------
    ConfigError
        If the depth is not positive or the width not sensible.
    """

    def __init__(
        self,
        rig: Rig,
        depth: float,
        width: int = 2048,
        projection: Literal["equirectangular", "cylindrical"] = "equirectangular",
        margin: float = SEAM_MARGIN,
    ) -> None:
        if not (math.isfinite(depth) and depth > 0):
            raise ConfigError(f"panorama: depth {depth:g} m must be positive")
        if not 64 <= width <= 16384:
            raise ConfigError(f"panorama: width {width} must be 64 to 16384 pixels")
        self.depth = depth
        self.centre = np.mean([rig.T_rig_view(name)[:3, 3] for name in rig.views], axis=0)
        directions = _grid(width, *_elevations(rig), projection == "cylindrical")
        points = self.centre + depth * directions
        pixels, valid = np.zeros((*points.shape[:2], 2)), np.zeros(points.shape[:2], dtype=bool)
        usable = UsablePixels(rig, margin)
        for name in rig.views:
            found, seen = usable.find(name, points)
            fresh = seen & ~valid
            pixels[fresh], valid = found[fresh], valid | seen
        self._resample = Resampler([pixels], [valid], rig.size)

    @property
    def mask(self) -> NDArray[np.uint8]:
        """Pixels that a view sees as 255, holes as 0, (height, width)."""
        return self._resample.valid[0].astype(np.uint8) * 255

    def __call__(self, image: Image) -> Image:
        """Make the panorama of a raw frame; see `Unwrapper.__call__` for what it takes and raises."""
        (picture,) = self._resample(image)
        v, u = np.nonzero(~self._resample.valid[0])
        white = 1.0 if picture.dtype == np.float32 else np.iinfo(picture.dtype).max
        shade = np.where((u + v) % _HATCH < _HATCH // 4, 0.6 * white, 0.2 * white).astype(picture.dtype)
        picture[v, u] = shade if picture.ndim == 2 else shade[:, None]
        return picture


def _elevations(rig: Rig) -> tuple[float, float]:
    """Lowest and highest elevation that any view sees, in radians."""
    upward = np.concatenate([seen_directions(rig, name)[:, 2] for name in rig.views])
    elevations = np.clip(np.arcsin(np.clip(upward, -1.0, 1.0)), -_STEEPEST, _STEEPEST)
    return float(elevations.min()), float(elevations.max())


def _grid(width: int, low: float, high: float, cylindrical: bool) -> Array:
    """Directions (H, W, 3) from the centre: on the unit sphere or on the unit cylinder."""
    step = math.tau / width
    azimuth = (np.arange(width) + 0.5) * step - math.pi
    top, bottom = (math.tan(high), math.tan(low)) if cylindrical else (high, low)
    rows = max(2, round((top - bottom) / step))
    upward = top - (np.arange(rows) + 0.5) * step
    across, climb = (np.ones(rows), upward) if cylindrical else (np.cos(upward), np.sin(upward))
    flat = np.stack([np.sin(azimuth), np.cos(azimuth)], axis=1)
    return np.concatenate(
        [across[:, None, None] * flat, np.broadcast_to(climb[:, None, None], (rows, width, 1))], axis=2
    )
