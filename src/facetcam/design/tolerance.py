"""How well a rig must be built: build errors to pixel errors, before and after calibration.

A built rig is followed backwards from the pixel, which is explicit even for a mirror that is not flat: pixel,
ray, hit by hit, to a point of the room. The plane model projects that point; the difference is the error.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from facetcam.design.areas import Area, view_areas
from facetcam.design.plane_model import ARCMIN, PlaneModel
from facetcam.design.spec import Body, Tolerance
from facetcam.errors import ConfigError
from facetcam.geometry import se3
from facetcam.rig import Rig

Array = NDArray[np.float64]

_GRID = 48  # sample pixels across the frame
_POINTS = 40  # samples of each view for the fit, and as many to judge it by
_PROBE = 1e-5  # radians or metres of a numeric derivative
_FAR = 1e4  # metres: what moves there is turned, not shifted


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
    depth: float  # metres of the points that the sensitivities to a shift are of

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
    model = PlaneModel(rig)
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
    depth = min(tolerance.depths, key=lambda metres: abs(metres - 1.0))
    moves = sensitivities(rig, samples, depth)
    return ToleranceReport(rig.view_names, before, after, shifts, moves, depth)


def sensitivities(rig: Rig, samples: dict[str, Array], depth: float = 1.0) -> list[Sensitivity]:
    """What a tilt of one arc minute and a shift of 0.1 mm of the last mirror, or of the camera, do to a view.

    The rules: a tilt d turns the view by 2 d, so a far point amid the picture by 2 d f pixels; a shift e
    moves points at depth Z by up to 2 e f / Z.
    """
    model, found = PlaneModel(rig), []
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
    model: PlaneModel, view: str, pixels: Array, depth: float, parameters: list[int], amount: float
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


def _rms_by_view(model: PlaneModel, errors: Array, points: dict[str, tuple[Array, Array]]) -> list[float]:
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
    raise ConfigError(
        f"tolerance: view '{name}' has too few pixels to be judged; "
        "give a longer focal length, or --no-tolerance"
    )


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
