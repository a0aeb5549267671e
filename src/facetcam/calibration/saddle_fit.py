"""Corners to a hundredth of a pixel: two blurred edges that cross, fitted to the grey values.

Methods that look for where gradients meet (`cv2.cornerSubPix`) interpolate between pixels, which draws every
corner of a board that stands square to the sensor the same way, by up to 0.03 px. Here nothing is
interpolated: the model is compared with the pixels as they are.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import erf

Array = NDArray[np.float64]

_DIRECTIONS = 72  # samples round a ring
_RINGS = (0.7, 1.0)
_LOOK = 1.2  # strips: as far as only the edges are seen
_ROUNDS = 5
_SETTLED = 0.02  # pixels of the last step
_BLUR = 0.8  # pixels, to begin with
_SHARPEST, _BLUREST = 0.35, 0.5  # pixels; of the radius
_DAMPING = 1e-6
_FARTHEST = 1.0  # pixels a step
_TURN = 0.2  # radians a step
_MOST = 400_000  # pixels fitted at a time: bounds the memory


def edge_directions(image: NDArray[np.uint8], pixels: Array, radius: ArrayLike) -> tuple[Array, Array]:
    """Directions of the rising and the falling edge through corners, from second harmonics of two rings.

    Parameters
    ----------
    image : (H, W) uint8 array
    pixels : (N, 2) array
    radius : float or (N,) array
        Of the outer ring, pixels.

    Returns
    -------
    rising, falling : (N,) arrays
        Radians, modulo pi; turning from x towards y, the image becomes bright at a rising edge.
    """
    angle = 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    outer = np.broadcast_to(np.asarray(radius, dtype=np.float64), len(pixels))[:, None, None]
    total = np.zeros((len(pixels), _DIRECTIONS))
    for ring in _RINGS:
        at = (pixels[:, None] + ring * outer * circle).astype(np.float32)
        total += cv2.remap(image, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    half = _DIRECTIONS // 2
    folded = total[:, :half] + total[:, half:]  # opposite quarters are alike
    level = 0.5 * (folded.max(axis=1) + folded.min(axis=1))
    # The middle of the bright quarter, and its width, from where it is bright.
    doubled = np.exp(2j * angle[:half])
    middle = 0.5 * np.angle(((folded > level[:, None]) * doubled).sum(axis=1))
    span = np.maximum(np.ptp(folded, axis=1), 1e-9)
    share = np.clip((folded - level[:, None]) / (0.5 * span[:, None]), -1, 1)
    width = 0.25 * np.pi * (1.0 + share.mean(axis=1))  # half of the bright quarter
    return (middle - width) % np.pi, (middle + width) % np.pi


def fit_saddles(image: NDArray[np.uint8], start: Array, radius: float, strip: float) -> Array:
    """Fit the crossing of two blurred edges to the pixels round each corner.

    Free are the corner, the directions of both edges, their blur, the two grey levels, and a slope of the
    light. What lies farther from both edges than `strip` is left out: it may be anything.

    Parameters
    ----------
    image : (H, W) uint8 array
    start : (N, 2) array
        Pixels, good to about one.
    radius : float
        Of what is looked at, pixels.
    strip : float
        To either side of the edges, pixels.

    Returns
    -------
    (N, 2) array
        The corners; NaN where the fit does not settle, or not within `radius`.
    """
    if not len(start):
        return start.copy()
    reach = int(np.ceil(radius)) + 1
    rows = np.array_split(np.arange(len(start)), 1 + len(start) * (2 * reach + 1) ** 2 // _MOST)
    return np.concatenate([_fitted(image, start[part], radius, strip, reach) for part in rows])


def _fitted(image: NDArray[np.uint8], start: Array, radius: float, strip: float, reach: int) -> Array:
    angles = np.stack(edge_directions(image, start, _LOOK * strip), axis=1)
    at, weight = _round(start, angles, radius, strip, reach)
    limits = np.array(image.shape[::-1]) - 1
    inside = np.clip(at, 0, limits)
    weight = weight * (inside == at).all(axis=2)
    grey = image[inside[..., 1], inside[..., 0]].astype(np.float64)
    values = np.column_stack([start, angles, np.full(len(start), _BLUR)])
    for _ in range(_ROUNDS):
        before, values = values, _stepped(values, at, grey, weight, radius)
    found = values[:, :2]
    settled = np.linalg.norm(found - before[:, :2], axis=1) < _SETTLED
    near = np.linalg.norm(found - start, axis=1) < radius
    return np.where((settled & near)[:, None], found, np.nan)


def _round(
    start: Array, angles: Array, radius: float, strip: float, reach: int
) -> tuple[NDArray[np.intp], Array]:
    """The pixels (N, M, 2) beside the edges of each corner, and how much they count: borders are soft."""
    side = np.arange(-reach, reach + 1)
    offsets = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    at = np.rint(start).astype(np.intp)[:, None] + offsets
    away = at - start[:, None]
    normals = np.stack([-np.sin(angles), np.cos(angles)], axis=2)
    beside = np.abs(np.einsum("nki,nmi->nkm", normals, away)).min(axis=1)
    narrow = strip * np.abs(np.sin(angles[:, 1] - angles[:, 0]))[:, None]  # leaning squares are less high
    weight = np.clip(radius + 0.5 - np.linalg.norm(away, axis=2), 0, 1) * np.clip(narrow + 0.5 - beside, 0, 1)
    most = int(np.count_nonzero(weight, axis=1).max())
    used = np.argsort(weight == 0, axis=1, kind="stable")[:, :most]
    return np.take_along_axis(at, used[..., None], axis=1), np.take_along_axis(weight, used, axis=1)


def _stepped(values: Array, at: NDArray[np.intp], grey: Array, weight: Array, radius: float) -> Array:
    """One Gauss-Newton step of corner, directions and blur (N, 5); the levels are solved for anew."""
    corner, angles, blur = values[:, :2], values[:, 2:4], values[:, 4, None, None]
    away = at - corner[:, None]
    along = np.stack([np.cos(angles), np.sin(angles)], axis=2)
    across = np.stack([-along[..., 1], along[..., 0]], axis=2)
    beside = np.einsum("nki,nmi->nkm", across, away)  # distances (N, 2, M) from the edges
    level = erf(beside / (np.sqrt(2.0) * blur))
    slope = np.sqrt(2.0 / np.pi) / blur * np.exp(-0.5 * (beside / blur) ** 2)
    light = np.stack(
        [np.ones_like(grey), level[:, 0] * level[:, 1], *np.moveaxis(away / radius, 2, 0)], axis=1
    )
    weighed = light * weight[:, None]
    levels = _solved(weighed @ np.swapaxes(light, 1, 2), weighed @ grey[..., None])
    off = grey[..., None] - np.swapaxes(light, 1, 2) @ levels
    by_beside = levels[:, 1, None] * slope * level[:, ::-1]  # of the grey by the distance from each edge
    by_corner = -np.einsum("nkm,nki->nim", by_beside, across)
    by_angles = -by_beside * np.einsum("nki,nmi->nkm", along, away)
    by_blur = -(by_beside * beside).sum(axis=1, keepdims=True) / blur
    J = np.concatenate([by_corner, by_angles, by_blur, light], axis=1)
    weighed = J * weight[:, None]
    step = _solved(weighed @ np.swapaxes(J, 1, 2), weighed @ off)[:, :5, 0]
    length = np.linalg.norm(step[:, :2], axis=1, keepdims=True)
    step[:, :2] *= _FARTHEST / np.maximum(length, _FARTHEST)
    moved = values + np.clip(
        step, [-np.inf, -np.inf, -_TURN, -_TURN, -0.5], [np.inf, np.inf, _TURN, _TURN, 0.5]
    )
    moved[:, 4] = np.clip(moved[:, 4], _SHARPEST, max(_BLUREST * radius, _SHARPEST))
    return moved


def _solved(A: Array, b: Array) -> Array:
    """Solutions of (N, K, K) systems, each damped a little."""
    size = np.einsum("nii->ni", A)
    damped = A + (_DAMPING * size + 1e-9)[:, :, None] * np.eye(A.shape[1])
    return np.asarray(np.linalg.solve(damped, b))
