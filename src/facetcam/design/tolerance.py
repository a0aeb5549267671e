"""How well a rig must be built: build errors to pixel errors, before and after calibration.

A built rig is followed backwards from the pixel, which is explicit even for a mirror that is not flat: pixel,
ray, hit by hit, to a point of the room. The plane model projects that point; the difference is the error.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from facetcam.design.areas import Area, view_areas
from facetcam.design.spec import Body, Tolerance
from facetcam.errors import ConfigError
from facetcam.geometry import se3
from facetcam.geometry.reflection import reflection
from facetcam.rig import Camera, Mirror, Rig

Array = NDArray[np.float64]

ARCMIN = math.radians(1.0 / 60.0)

_GRID = 48  # sample pixels across the frame
_POINTS = 40  # samples of each view for the fit, and as many to judge it by
_STEPS = 3  # of Gauss-Newton: the errors are small
_PROBE = 1e-5  # radians or metres of a numeric derivative
_FAR = 1e4  # metres: what moves there is turned, not shifted
_LEAST_NOISE = 1e-3  # pixels: below, the drawing would not count at all


@dataclass(frozen=True, slots=True)
class Sensitivity:
    """What one unit of one build error does to a view in pixels: median over samples, and by the rule."""

    view: str
    error: str
    pixels: float
    rule: float | None


@dataclass(frozen=True, slots=True)
class ToleranceReport:
    """Root mean square pixel errors of B builds in V views, as built (`before`) and after calibration.

    `seam_shift` (V,) is the standard deviation, in pixels, by which cutting errors move a view's edges.
    """

    views: tuple[str, ...]
    before: Array  # (B, V)
    after: Array  # (B, V)
    seam_shift: Array  # (V,)
    sensitivities: list[Sensitivity]

    @property
    def removed(self) -> Array:
        """Share (V,) of the root mean square error that calibration removes."""
        before, after = (np.sqrt((e**2).mean(axis=0)) for e in (self.before, self.after))
        share: Array = 1.0 - after / np.maximum(before, 1e-12)
        return share


def simulate_builds(
    rig: Rig,
    tolerance: Tolerance,
    seed: int = 0,
    body: Body | None = None,
    progress: Callable[[int, int | None], None] = lambda done, total: None,
) -> ToleranceReport:
    """Build the rig many times with random errors, and calibrate each build from noisy image points.

    Raises
    ------
    ConfigError
        If a view is too small to be sampled.
    """
    rng = np.random.default_rng(seed)
    areas = view_areas(rig, body)
    samples = {name: _samples(rig, name, areas[name], rng) for name in rig.views}
    model = _PlaneModel(rig)
    sigmas = model.sigmas(tolerance)
    before, after = np.zeros((2, tolerance.builds, len(rig.views)))
    for build in range(tolerance.builds):
        errors = rng.normal(size=model.size) * sigmas
        bows = {name: rng.normal() * tolerance.bow_um * 1e-6 for name in rig.mirrors}
        fit, judge = ({} for _ in range(2))
        for name, pixels in samples.items():
            depths = rng.choice(tolerance.depths, len(pixels))
            points = model.trace_back(name, pixels, depths, errors, bows)
            fit[name] = points[::2], pixels[::2] + rng.normal(0.0, tolerance.noise_px, pixels[::2].shape)
            judge[name] = points[1::2], pixels[1::2]
        before[build] = _rms_by_view(model, np.zeros(model.size), judge)
        after[build] = _rms_by_view(model, model.fitted(fit, sigmas, tolerance.noise_px), judge)
        progress(build + 1, tolerance.builds)
    shifts = np.array([_seam_shift(rig, name, tolerance.cut_mm * 1e-3) for name in rig.views])
    return ToleranceReport(rig.view_names, before, after, shifts, sensitivities(rig, samples))


def sensitivities(rig: Rig, samples: dict[str, Array], depth: float = 1.0) -> list[Sensitivity]:
    """What a tilt of one arc minute and a shift of 0.1 mm of the last mirror, or of the camera, do to a view.

    The rules: a tilt d turns the view by 2 d, so a far point amid the picture by 2 d f pixels; a shift e
    moves points at depth Z by up to 2 e f / Z.
    """
    model, found = _PlaneModel(rig), []
    focal = (rig.camera.fx + rig.camera.fy) / 2
    turn, move = model.size - 6, model.size - 3
    for name, view in rig.views.items():
        pixels = _nearest_to_axis(rig, samples[name])
        cases: list[tuple[str, list[int], float, float, float | None]] = []
        if view.mirrors:
            at = model.first(view.mirrors[-1])
            cases += [
                ("mirror tilted by 1'", [at, at + 1], ARCMIN, _FAR, 2 * ARCMIN * focal),
                ("mirror moved by 0.1 mm", [at + 2], 1e-4, depth, 2e-4 * focal / depth),
            ]
        cases += [
            ("camera turned by 1'", [turn, turn + 1], ARCMIN, _FAR, ARCMIN * focal),
            ("camera moved by 0.1 mm", [move, move + 1], 1e-4, depth, 1e-4 * focal / depth),
        ]
        for words, parameters, amount, at_depth, rule in cases:
            found.append(
                Sensitivity(name, words, _moved(model, name, pixels, at_depth, parameters, amount), rule)
            )
    return found


def _moved(
    model: _PlaneModel, view: str, pixels: Array, depth: float, parameters: list[int], amount: float
) -> float:
    """Pixels by which the worst mix of the parameters, of this size, moves points: median over the points."""
    points = model.trace_back(view, pixels, np.full(len(pixels), depth), np.zeros(model.size), {})
    moves = [model.project(view, points, amount * np.eye(model.size)[p]) - pixels for p in parameters]
    worst = np.linalg.svd(np.stack(moves, axis=2), compute_uv=False)[:, 0]
    return float(np.median(worst))


def _nearest_to_axis(rig: Rig, pixels: Array) -> Array:
    """The tenth of the samples nearest to the principal point, where the rules hold as they stand."""
    order = np.argsort(np.linalg.norm(pixels - (rig.camera.cx, rig.camera.cy), axis=1))
    return pixels[order[: max(4, len(pixels) // 10)]]


def _rms_by_view(model: _PlaneModel, errors: Array, points: dict[str, tuple[Array, Array]]) -> list[float]:
    residuals = [model.project(name, X, errors) - pixels for name, (X, pixels) in points.items()]
    return [float(np.sqrt((r**2).sum(axis=1).mean())) for r in residuals]


def _samples(rig: Rig, name: str, area: Area, rng: np.random.Generator) -> Array:
    """Pixels (N, 2) spread over a view, in random order."""
    step = rig.camera.width / _GRID
    for finer in (1, 4, 16):
        v, u = np.mgrid[0 : rig.camera.height : step / finer, 0 : rig.camera.width : step / finer]
        pixels = np.column_stack([u.ravel(), v.ravel()])
        rays = rig.camera.ray(pixels)
        seen = pixels[area.sees(rays @ area.R.T) & rays.any(axis=1)]
        if len(seen) >= 16:
            return rng.permutation(seen)[: 2 * _POINTS]
    raise ConfigError(f"tolerance: view '{name}' has too few pixels to be sampled")


def _seam_shift(rig: Rig, name: str, cut: float) -> float:
    """Standard deviation of the shift of a view's edges: cut f / z, z along the axis to the last mirror."""
    view = rig.views[name]
    polygon = rig.mirrors[view.mirrors[-1]].polygon if view.mirrors else None
    if polygon is None:
        return 0.0
    T = rig.T_rig_cam
    for mirror in view.mirrors[:-1]:
        T = rig.mirrors[mirror].reflection @ T
    z = se3.transform(se3.inverse(T), polygon)[:, 2]
    return float(cut * rig.camera.fx / np.median(z[z > 0])) if (z > 0).any() else 0.0


class _PlaneModel:
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
