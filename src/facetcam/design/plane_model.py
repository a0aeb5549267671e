"""A rig whose flat mirrors and camera are off by small errors, and a built one traced back from the pixel."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from facetcam.design.spec import Tolerance
from facetcam.geometry import se3
from facetcam.geometry.reflection import reflection
from facetcam.rig import Camera, Mirror, Rig

Array = NDArray[np.float64]

ARCMIN = math.radians(1.0 / 60.0)

_STEPS = 3  # of Gauss-Newton: the errors are small
_PROBE = 1e-5  # radians or metres of a numeric derivative
_LEAST_NOISE = 1e-3  # pixels: below, the drawing would not count at all


class PlaneModel:
    """A rig whose mirrors are tilted and shifted, and whose camera is moved, by a vector of errors.

    Three errors a mirror (tilts about two axes in it, shift along its normal), then six of the camera
    (rotation vector and translation in its own frame).
    """

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self._names = list(rig.mirrors)
        self._centres = {name: _middle(mirror, rig.T_rig_cam) for name, mirror in rig.mirrors.items()}
        self._tangents = {name: _tangents(mirror.normal) for name, mirror in rig.mirrors.items()}
        self._wide, self._margin = _with_margin(rig.camera)
        self.size = 3 * len(self._names) + 6

    def first(self, mirror: str) -> int:
        return 3 * self._names.index(mirror)

    def sigmas(self, tolerance: Tolerance) -> Array:
        tilt, camera = tolerance.tilt_arcmin * ARCMIN, tolerance.camera_arcmin * ARCMIN
        mirror = [tilt, tilt, tolerance.offset_mm * 1e-3]
        return np.array(mirror * len(self._names) + [camera] * 3 + [tolerance.camera_mm * 1e-3] * 3)

    def plane(self, name: str, errors: Array) -> tuple[Array, float]:
        """Normal and offset of a mirror with its errors; it tilts about its middle."""
        tilt_x, tilt_y, shift = errors[self.first(name) : self.first(name) + 3]
        a, b = self._tangents[name]
        turn = Rotation.from_rotvec(tilt_x * a + tilt_y * b)
        normal: Array = turn.apply(self._rig.mirrors[name].normal)
        return normal, float(normal @ self._centres[name]) + shift

    def camera_pose(self, errors: Array) -> Array:
        R, t = Rotation.from_rotvec(errors[-6:-3]).as_matrix(), errors[-3:]
        pose: Array = self._rig.T_rig_cam @ se3.from_rotation_translation(R, t)
        return pose

    def project(self, view: str, points: Array, errors: Array) -> Array:
        """Pixels (N, 2) of points (N, 3) of the rig frame."""
        T = self.camera_pose(errors)
        for name in self._rig.views[view].mirrors:
            T = reflection(*self.plane(name, errors)) @ T
        return self._wide.project(se3.transform(se3.inverse(T), points))[0] - self._margin

    def trace_back(
        self, view: str, pixels: Array, depths: Array, errors: Array, bows: dict[str, float]
    ) -> Array:
        """Points (N, 3) that pixels see `depths` (N,) metres behind the last of the bowed mirrors."""
        T = self.camera_pose(errors)
        origins = np.broadcast_to(T[:3, 3], (len(pixels), 3))
        directions = self._rig.camera.ray(pixels) @ T[:3, :3].T
        for name in self._rig.views[view].mirrors:
            normal, offset = self.plane(name, errors)
            way = (offset - origins @ normal) / (directions @ normal)
            origins = origins + way[:, None] * directions
            normals = self._bowed(name, normal, origins, bows.get(name, 0.0))
            cosine = np.einsum("ij,ij->i", directions, normals)
            directions = directions - 2 * cosine[:, None] * normals
        points: Array = origins + depths[:, None] * directions
        return points

    def _bowed(self, name: str, normal: Array, hits: Array, bow: float) -> Array:
        """Normals (N, 3) of a mirror whose middle stands `bow` metres above its corners."""
        polygon = self._rig.mirrors[name].polygon
        if polygon is None or bow == 0.0:
            return np.broadcast_to(normal, hits.shape)
        radius = np.linalg.norm(polygon - self._centres[name], axis=1).max()
        outward = hits - self._centres[name]
        outward -= np.outer(outward @ normal, normal)
        normals = normal + 2.0 * bow / radius**2 * outward
        unit: Array = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        return unit

    def fitted(self, points: dict[str, tuple[Array, Array]], sigmas: Array, noise: float) -> Array:
        """The likeliest errors, given image points of known points and the tolerance of the drawing.

        Gauss-Newton. What the images leave open (base mirror and camera may move together) stays as drawn.
        """

        def residuals(errors: Array) -> Array:
            return np.concatenate([(self.project(n, X, errors) - p).ravel() for n, (X, p) in points.items()])

        weight, scale = max(noise, _LEAST_NOISE), np.maximum(sigmas, 1e-9)
        errors = np.zeros(self.size)
        for _ in range(_STEPS):
            now = residuals(errors)
            jacobian = np.column_stack(
                [(residuals(errors + d) - now) / _PROBE for d in _PROBE * np.eye(self.size)]
            )
            rows = np.vstack([jacobian * scale / weight, np.eye(self.size)])
            target = np.concatenate([now / weight, errors / scale])
            errors = errors - scale * np.linalg.lstsq(rows, target)[0]
        return errors


def _middle(mirror: Mirror, T_rig_cam: Array) -> Array:
    if mirror.polygon is not None:
        middle: Array = mirror.polygon.mean(axis=0)
        return middle
    camera = T_rig_cam[:3, 3]
    foot: Array = camera + (mirror.offset - mirror.normal @ camera) * mirror.normal
    return foot


def _tangents(normal: Array) -> tuple[Array, Array]:
    a = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    a /= np.linalg.norm(a)
    return a, np.cross(normal, a)


def _with_margin(camera: Camera) -> tuple[Camera, Array]:
    """The camera on a larger sensor, so that a point is not lost when an error moves it over the border."""
    margin = min(camera.width, (16384 - max(camera.width, camera.height)) // 2)
    wide = replace(
        camera, width=camera.width + 2 * margin, height=camera.height + 2 * margin,
        cx=camera.cx + margin, cy=camera.cy + margin,
    )  # fmt: skip
    return wide, np.array([margin, margin], dtype=np.float64)
