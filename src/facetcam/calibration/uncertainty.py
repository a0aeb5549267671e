"""Covariance of the rig carried to the pixels of each view."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from facetcam.calibration import lens
from facetcam.calibration.covariance import Knowledge
from facetcam.calibration.fit import Fit
from facetcam.calibration.quality import UncertaintyMap
from facetcam.geometry import se3
from facetcam.rig import Rig

Array = NDArray[np.float64]

_GRID = 40  # samples along the longer side of a view
_COARSE = 160  # of the sensor, by which the view is found on it
_MOST = 500  # corners of a view by which rig frames are aligned
_DEPTHS = (0.7, 1.5, 4.0)  # metres, at which rig frames are aligned


def uncertainty_maps(fit: Fit, known: Knowledge, depth: float = 2.0) -> tuple[UncertaintyMap, ...]:
    """Sigma of every view on a grid, for points `depth` metres away, after aligning rig frames.

    The rig frame itself is a matter of choice; only what moves views against each other or
    bends them counts.
    """
    rig = fit.rig
    to_motion = _motion_per_step(fit, known)
    maps = []
    for index, name in enumerate(fit.views):
        u, v = _grid(rig, name)
        pixels = np.stack([u.ravel(), v.ravel()], axis=1)
        inside = np.flatnonzero(rig.sees(name, pixels))
        raw, by_motion, by_points = _slopes(fit, known, index, _at(rig, name, pixels[inside], depth))
        aligned = raw + by_motion @ to_motion
        covariance = aligned @ known.covariance @ np.swapaxes(aligned, 1, 2)
        sigma = np.sqrt(np.maximum(np.linalg.eigvalsh(covariance)[:, 1], 0.0)) if len(inside) else np.empty(0)
        # Pixels a metre across the ray: the smaller singular value of the projection there.
        scale = np.linalg.svd(by_points, compute_uv=False)[:, 1] if len(inside) else np.empty(0)
        px, mm = np.full((2, len(pixels)), np.nan)
        px[inside], mm[inside] = sigma, 1e3 * sigma / np.maximum(scale, 1e-12)
        maps.append(UncertaintyMap(name, u, v, px.reshape(u.shape), mm.reshape(u.shape), depth))
    return tuple(maps)


def _grid(rig: Rig, view: str) -> tuple[Array, Array]:
    """Pixels (H, W) of a grid over the part of the sensor on which a view lies."""
    low, high = np.zeros(2), np.array(rig.size, dtype=np.float64)
    for count in (_COARSE, _GRID):
        step = float((high - low).max()) / count
        u, v = np.meshgrid(*(np.arange(a + step / 2, b, step) for a, b in zip(low, high)))
        seen = rig.sees(view, np.stack([u.ravel(), v.ravel()], axis=1)).reshape(u.shape)
        if count == _GRID or not seen.any():
            break
        low = np.array([u[seen].min(), v[seen].min()]) - step / 2
        high = np.array([u[seen].max(), v[seen].max()]) + step / 2
    return u, v


def aligned_slopes(fit: Fit, known: Knowledge) -> tuple[Array, Array]:
    """Derivatives (M, F) of pixels over all views by the free numbers, raw and with frames aligned."""
    raws, motions = _sampled(fit, known)
    to_motion = _solve_motion(raws, motions)
    return raws, raws + motions @ to_motion


def _motion_per_step(fit: Fit, known: Knowledge) -> Array:
    """The motion (6, F) of the rig frame that best undoes a step of the free numbers where corners were seen.

    Elsewhere the lens may be off by many pixels, which must not turn the whole rig.
    """
    looks = fit.looks.only(fit.kept)
    points = fit.state.in_rig(looks)[1]
    raws, motions = [], []
    for view, rows in looks.by_view:
        raw, by_motion, _ = _slopes(fit, known, view, points[rows[:: max(1, len(rows) // _MOST)]])
        raws.append(raw.reshape(-1, raw.shape[2]))
        motions.append(by_motion.reshape(-1, 6))
    return _solve_motion(np.concatenate(raws), np.concatenate(motions))


def _solve_motion(raws: Array, motions: Array) -> Array:
    return np.asarray(-np.linalg.lstsq(motions, raws, rcond=None)[0], dtype=np.float64)


def _sampled(fit: Fit, known: Knowledge) -> tuple[Array, Array]:
    """Derivatives by the free numbers and by a motion of the rig frame, at pixels and depths of all views."""
    rig, (width, height) = fit.rig, fit.nominal.size
    u, v = np.meshgrid(np.linspace(0, width - 1, 25), np.linspace(0, height - 1, 25))
    pixels = np.stack([u.ravel(), v.ravel()], axis=1)
    raws, motions = [np.empty((0, len(known.free)))], [np.empty((0, 6))]
    for index, name in enumerate(fit.views):
        inside = rig.sees(name, pixels)
        for depth in _DEPTHS:
            raw, by_motion, _ = _slopes(fit, known, index, _at(rig, name, pixels[inside], depth))
            raws.append(raw.reshape(-1, raw.shape[2]))
            motions.append(by_motion.reshape(-1, 6))
    return np.concatenate(raws), np.concatenate(motions)


def _at(rig: Rig, view: str, pixels: Array, depth: float) -> Array:
    """Points (N, 3) of the rig frame on the rays of pixels (N, 2)."""
    origins, directions = rig.ray(view, pixels)
    return np.asarray(origins + depth * directions)


def _slopes(fit: Fit, known: Knowledge, view: int, points: Array) -> tuple[Array, Array, Array]:
    """Derivatives of pixels (N, 2) by free numbers, by a motion of the rig frame, and by the point."""
    optics, state = fit.state.optics, fit.state
    by_rig, by_optics = optics.derivatives(view, points)
    seen = optics.into_camera(view, points)
    _, by_seen, by_lens = lens.project_with_derivatives(state.model, state.intrinsics, seen)
    everything = np.zeros((len(points), 2, state.first_board))
    lenses = len(state.intrinsics)
    everything[:, :, :lenses] = by_lens
    for place, column in enumerate(optics.columns(view)):  # a mirror met twice has its columns twice
        everything[:, :, lenses + column] += (by_seen @ by_optics)[:, :, place]
    by_points = by_seen @ by_rig
    by_motion = np.concatenate([by_points @ -se3.skew(points), by_points], axis=2)
    return everything[:, :, known.free], by_motion, by_points
