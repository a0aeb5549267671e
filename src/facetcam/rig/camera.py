"""Camera models: a point in front of the lens to a pixel, and a pixel to a ray."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import ArrayLike, NDArray

from facetcam import _core
from facetcam.errors import RigError

Array = NDArray[np.float64]

BROWN_CONRADY = "brown-conrady"
KANNALA_BRANDT = "kannala-brandt"
COEFFICIENTS = {BROWN_CONRADY: 5, KANNALA_BRANDT: 4}

_SMALLEST = 8  # pixels a side; below, nothing can be measured
_LARGEST = 16384  # pixels a side; above, 32-bit image maps lose their sub-pixel digits


@dataclass(frozen=True)
class Camera:
    """Intrinsics of one lens and sensor.

    Parameters
    ----------
    model : str
        `brown-conrady` (distortion k1, k2, p1, p2, k3 as in OpenCV's `calibrateCamera`) or
        `kannala-brandt` (k1..k4 as in OpenCV's `fisheye`).
    width, height : int
        Sensor size in pixels.
    fx, fy, cx, cy : float
        Focal lengths and principal point in pixels; (0, 0) is the centre of the first pixel.
    distortion : tuple of float

    Raises
    ------
    RigError
        If the model is unknown, a number is not finite, or the size or a focal length is out of range.
    """

    model: str
    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...]

    def __post_init__(self) -> None:
        if self.model not in COEFFICIENTS:
            raise RigError(f"camera: unknown model '{self.model}', use one of {', '.join(COEFFICIENTS)}")
        if len(self.distortion) != COEFFICIENTS[self.model]:
            wanted = COEFFICIENTS[self.model]
            raise RigError(
                f"camera: {self.model} takes {wanted} distortion numbers, got {len(self.distortion)}"
            )
        if min(self.width, self.height) < _SMALLEST or max(self.width, self.height) > _LARGEST:
            limits = f"{_SMALLEST} to {_LARGEST} pixels a side"
            raise RigError(f"camera: the size {self.width}x{self.height} must be {limits}")
        if not all(map(math.isfinite, (self.fx, self.fy, self.cx, self.cy, *self.distortion))):
            raise RigError("camera: fx, fy, cx, cy and distortion must be finite numbers")
        if self.fx <= 0 or self.fy <= 0:
            raise RigError(f"camera: focal lengths fx={self.fx:g}, fy={self.fy:g} must be positive")

    @property
    def K(self) -> Array:
        """Camera matrix (3, 3)."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def mirrored(self) -> Camera:
        """Return the camera of the image flipped left to right: x' = W - 1 - x."""
        distortion = list(self.distortion)
        if self.model == BROWN_CONRADY:
            distortion[3] = -distortion[3]
        return replace(self, cx=self.width - 1 - self.cx, distortion=tuple(distortion))

    def project(self, points: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
        """Project points of the camera frame.

        Parameters
        ----------
        points : (N, 3) array
            Metres, camera axes x right, y down, z forward.

        Returns
        -------
        pixels : (N, 2) array
            Zero where not valid.
        valid : (N,) bool array
            True where the point is in front of the lens, inside the field where the distortion is
            one-to-one, and lands on the sensor.
        """
        points = np.ascontiguousarray(points, dtype=np.float64).reshape(-1, 3)
        return self._lens().project(points)

    def ray(self, pixels: ArrayLike) -> Array:
        """Unit directions (N, 3) in the camera frame of pixels (N, 2); zero where the lens gives none."""
        pixels = np.ascontiguousarray(pixels, dtype=np.float64).reshape(-1, 2)
        return self._lens().rays(pixels)

    def _lens(self) -> _core.Lens:
        # Made for each call: a native object kept here would forbid pickling the camera.
        tangential = self.distortion[2:4] if self.model == BROWN_CONRADY else (0.0, 0.0)
        radial = (*self._radial[1:], 0.0)[:4]
        return _core.Lens(
            kannala_brandt=self.model == KANNALA_BRANDT,
            size=(self.width, self.height),
            intrinsics=(self.fx, self.fy, self.cx, self.cy),
            radial=radial,
            tangential=tangential,
            limit=self._limit,
        )

    @cached_property
    def _radial(self) -> tuple[float, ...]:
        """Coefficients of 1 + a r^2 + b r^4 + ..., lowest first."""
        if self.model == KANNALA_BRANDT:
            return (1.0, *self.distortion)
        k1, k2, _, _, k3 = self.distortion
        return (1.0, k1, k2, k3)

    @cached_property
    def _limit(self) -> float:
        """Plane radius (kannala-brandt: angle) up to which the distorted radius grows with the true one."""
        slopes = polynomial.polytrim(np.array([(2 * i + 1) * c for i, c in enumerate(self._radial)]), 1e-12)
        turning = [r.real for r in polynomial.polyroots(slopes) if abs(r.imag) < 1e-9 and r.real > 0]
        radius = math.sqrt(min(turning)) if turning else math.inf
        return min(radius, math.pi) if self.model == KANNALA_BRANDT else radius
