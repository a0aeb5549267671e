"""Camera models: a point in front of the lens to a pixel, and a pixel to a ray."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import ArrayLike, NDArray

from facetcam.errors import RigError

Array = NDArray[np.float64]

BROWN_CONRADY = "brown-conrady"
KANNALA_BRANDT = "kannala-brandt"
COEFFICIENTS = {BROWN_CONRADY: 5, KANNALA_BRANDT: 4}

_NEWTON_STEPS = 30
_NEWTON_TOLERANCE = 1e-13


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
        If the model is unknown, a number is not finite, or sizes are not positive.
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
        if self.width < 1 or self.height < 1:
            raise RigError(f"camera: the size {self.width}x{self.height} must be positive")
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
        points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        in_front = (
            points[:, 2] > 1e-9 if self.model == BROWN_CONRADY else np.linalg.norm(points, axis=1) > 1e-9
        )
        safe = np.where(in_front[:, None], points, (0.0, 0.0, 1.0))
        plane, angle = self._to_plane(safe)
        valid = in_front & (angle <= self._angle_limit)
        distorted = self._distort(np.where(valid[:, None], plane, 0.0))[0]
        pixels = distorted * (self.fx, self.fy) + (self.cx, self.cy)
        valid &= np.all((pixels >= -0.5) & (pixels < (self.width - 0.5, self.height - 0.5)), axis=1)
        return np.where(valid[:, None], pixels, 0.0), valid

    def ray(self, pixels: ArrayLike) -> Array:
        """Unit directions (N, 3) in the camera frame of pixels (N, 2), by Newton's method."""
        pixels = np.asarray(pixels, dtype=np.float64).reshape(-1, 2)
        target = (pixels - (self.cx, self.cy)) / (self.fx, self.fy)
        plane = target.copy()
        for _ in range(_NEWTON_STEPS):
            value, jacobian = self._distort(plane)
            error = value - target
            if not error.size or np.abs(error).max() < _NEWTON_TOLERANCE:
                break
            determinant = jacobian[:, 0, 0] * jacobian[:, 1, 1] - jacobian[:, 0, 1] * jacobian[:, 1, 0]
            determinant = np.where(np.abs(determinant) < 1e-6, 1e-6, determinant)
            plane[:, 0] -= (jacobian[:, 1, 1] * error[:, 0] - jacobian[:, 0, 1] * error[:, 1]) / determinant
            plane[:, 1] -= (jacobian[:, 0, 0] * error[:, 1] - jacobian[:, 1, 0] * error[:, 0]) / determinant
        return self._from_plane(plane)

    def _to_plane(self, points: Array) -> tuple[Array, Array]:
        """Undistorted plane coordinates and the angle from the optical axis."""
        radius = np.hypot(points[:, 0], points[:, 1])
        angle = np.arctan2(radius, points[:, 2])
        if self.model == BROWN_CONRADY:
            return points[:, :2] / points[:, 2:], angle
        scale = np.where(
            radius > 1e-12, angle / np.maximum(radius, 1e-12), 1.0 / np.maximum(points[:, 2], 1e-12)
        )
        return points[:, :2] * scale[:, None], angle

    def _from_plane(self, plane: Array) -> Array:
        if self.model == BROWN_CONRADY:
            rays = np.column_stack([plane, np.ones(len(plane))])
            return rays / np.linalg.norm(rays, axis=1, keepdims=True)
        angle = np.linalg.norm(plane, axis=1)
        return np.column_stack([plane * np.sinc(angle / np.pi)[:, None], np.cos(angle)])

    def _distort(self, plane: Array) -> tuple[Array, Array]:
        """Distorted plane coordinates (N, 2) and their derivative (N, 2, 2)."""
        x, y = plane[:, 0], plane[:, 1]
        r2 = x * x + y * y
        radial = polynomial.polyval(r2, self._radial)
        slope = polynomial.polyval(r2, polynomial.polyder(self._radial))
        p1, p2 = self.distortion[2:4] if self.model == BROWN_CONRADY else (0.0, 0.0)
        value = np.stack(
            [
                x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
                y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
            ],
            axis=1,
        )
        xx = radial + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x
        xy = 2.0 * x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y
        yy = radial + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x
        return value, np.stack([np.stack([xx, xy], 1), np.stack([xy, yy], 1)], axis=1)

    @cached_property
    def _radial(self) -> tuple[float, ...]:
        """Coefficients of 1 + a r^2 + b r^4 + ..., lowest first."""
        if self.model == KANNALA_BRANDT:
            return (1.0, *self.distortion)
        k1, k2, _, _, k3 = self.distortion
        return (1.0, k1, k2, k3)

    @cached_property
    def _angle_limit(self) -> float:
        """Largest angle from the axis up to which distorted radius grows with the true one, in radians."""
        slopes = np.trim_zeros([(2 * i + 1) * c for i, c in enumerate(self._radial)], "b")
        turning = [r.real for r in polynomial.polyroots(slopes) if abs(r.imag) < 1e-9 and r.real > 0]
        radius = math.sqrt(min(turning)) if turning else math.inf
        return min(radius, math.pi) if self.model == KANNALA_BRANDT else math.atan(radius)
