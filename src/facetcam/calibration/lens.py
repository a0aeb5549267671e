"""Projection through the lens with its derivatives, as the solver needs them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from facetcam.rig.camera import BROWN_CONRADY, KANNALA_BRANDT, Camera

Array = NDArray[np.float64]

NAMES = {
    BROWN_CONRADY: ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"),
    KANNALA_BRANDT: ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4"),
}

_BEHIND = 0.02  # sine of the least elevation over the image plane that a brown-conrady lens takes
_FAR = 1e5  # pixels: where a point that the lens cannot see is put


def values_of(camera: Camera) -> Array:
    """Intrinsics in the order of `NAMES`."""
    return np.array([camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion])


def camera_of(values: Array, like: Camera) -> Camera:
    """The camera of such values."""
    fx, fy, cx, cy, *distortion = (float(v) for v in values)
    return replace(like, fx=fx, fy=fy, cx=cx, cy=cy, distortion=tuple(distortion))


def tolerances(camera: Camera, focal: float) -> Array:
    """How far each intrinsic may stand from the drawing, one standard deviation.

    A distortion coefficient may move the corner of the image by 30 % of its radius (a tangential one by 5 %).
    """
    reach = 0.5 * float(np.hypot(camera.width / camera.fx, camera.height / camera.fy))
    if camera.model == KANNALA_BRANDT:
        reach = min(reach, np.pi / 2)
    shift = 0.05 * camera.width
    radial = [0.3 / reach ** (2 * i) for i in range(1, 5)]
    if camera.model == BROWN_CONRADY:
        radial = [radial[0], radial[1], 0.05 / reach, 0.05 / reach, radial[2]]
    return np.array([focal * camera.fx, focal * camera.fy, shift, shift, *radial])


def project(model: str, values: Array, points: Array) -> Array:
    """Pixels (N, 2) of points (N, 3) of the camera frame, the sensor unbounded.

    A point that the lens cannot see lands far outside.
    """
    return _SHAPES[model](values, points, False)[0]


def project_with_derivatives(model: str, values: Array, points: Array) -> tuple[Array, Array, Array]:
    """Pixels (N, 2), their derivatives by the point (N, 2, 3) and by the intrinsics (N, 2, I)."""
    return _SHAPES[model](values, points, True)


def _brown_conrady(values: Array, points: Array, derivatives: bool) -> tuple[Array, Array, Array]:
    fx, fy, cx, cy, k1, k2, p1, p2, k3 = values
    unseen = points[:, 2] <= _BEHIND * np.linalg.norm(points, axis=1)
    z = np.where(unseen, 1.0, points[:, 2])
    x, y = points[:, 0] / z, points[:, 1] / z
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    bent = np.stack([x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
                     y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y], axis=1)  # fmt: skip
    focal = np.array([fx, fy])
    pixels = np.where(unseen[:, None], _FAR, focal * bent + (cx, cy))
    if not derivatives:
        return pixels, _EMPTY, _EMPTY
    slope = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3))  # of `radial` by r2, doubled
    by_plane = np.empty((len(points), 2, 2))
    by_plane[:, 0, 0] = radial + slope * x * x + 2 * p1 * y + 6 * p2 * x
    by_plane[:, 1, 1] = radial + slope * y * y + 6 * p1 * y + 2 * p2 * x
    by_plane[:, 0, 1] = by_plane[:, 1, 0] = slope * x * y + 2 * p1 * x + 2 * p2 * y
    plane_by_point = np.zeros((len(points), 2, 3))
    plane_by_point[:, 0, 0] = plane_by_point[:, 1, 1] = 1.0 / z
    plane_by_point[:, 0, 2], plane_by_point[:, 1, 2] = -x / z, -y / z
    by_point = focal[:, None] * (by_plane @ plane_by_point)
    xy = np.stack([x, y], axis=1)
    columns = [xy * r2[:, None], xy * (r2**2)[:, None], np.stack([2 * x * y, r2 + 2 * y * y], axis=1),
               np.stack([r2 + 2 * x * x, 2 * x * y], axis=1), xy * (r2**3)[:, None]]  # fmt: skip
    by_values = _by_values(bent, focal, columns)
    by_point[unseen], by_values[unseen] = 0.0, 0.0
    return pixels, by_point, by_values


def _kannala_brandt(values: Array, points: Array, derivatives: bool) -> tuple[Array, Array, Array]:
    focal, centre, k = values[:2], values[2:4], values[4:]
    x, y, z = points.T
    rho = np.maximum(np.hypot(x, y), 1e-12)
    away = np.stack([x, y], axis=1) / rho[:, None]
    angle = np.arctan2(rho, z)
    powers = [angle ** (2 * i + 3) for i in range(4)]
    bent_angle = angle + sum(c * p for c, p in zip(k, powers))
    bent = away * bent_angle[:, None]
    pixels = focal * bent + centre
    if not derivatives:
        return pixels, _EMPTY, _EMPTY
    slope = 1.0 + sum((2 * i + 3) * c * angle ** (2 * i + 2) for i, c in enumerate(k))
    norm2 = rho**2 + z**2
    angle_by_point = np.column_stack([away * (z / norm2)[:, None], -rho / norm2])
    across = np.stack([-away[:, 1], away[:, 0]], axis=1)
    by_point = (slope[:, None] * away)[:, :, None] * angle_by_point[:, None, :]
    turn = np.where(rho > 1e-9, bent_angle / rho, 1.0 / np.maximum(z, 1e-9))
    by_point[:, :, :2] += turn[:, None, None] * across[:, :, None] * across[:, None, :]
    by_values = _by_values(bent, focal, [away * p[:, None] for p in powers])
    return pixels, focal[:, None] * by_point, by_values


def _by_values(bent: Array, focal: Array, columns: list[Array]) -> Array:
    """Derivatives by focal lengths, principal point, and the distortion, whose columns come unscaled."""
    out = np.zeros((len(bent), 2, 4 + len(columns)))
    out[:, 0, 0], out[:, 1, 1] = bent[:, 0], bent[:, 1]
    out[:, 0, 2] = out[:, 1, 3] = 1.0
    for i, column in enumerate(columns):
        out[:, :, 4 + i] = focal * column
    return out


_EMPTY = np.empty((0, 2, 0))
_SHAPES = {BROWN_CONRADY: _brown_conrady, KANNALA_BRANDT: _kannala_brandt}
