"""What every pixel of the raw frame shows, by following its ray: a view, or why it is dead."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam.design.spec import Body
from facetcam.design.unfolding import body_faces
from facetcam.geometry import se3
from facetcam.rig import NO_VIEW, Mirror, Rig
from facetcam.rig.tracing import LEAVES, NOWHERE, Tracer

Array = NDArray[np.float64]

NO_MIRROR, CAMERA, PARASITE, NO_RAY = "no mirror", "camera's own reflection", "parasitic path", "no ray"
CAUSES = (NO_MIRROR, CAMERA, PARASITE, NO_RAY)

BOUNCES = 6  # a ray that is still between mirrors after these is lost in a corner
_NAMED = 3  # parasitic paths that get a pixel as their example
_BAND = 128  # rows traced at once


@dataclass(frozen=True, slots=True)
class SensorMap:
    """The raw frame, pixel by pixel (or every `step`-th).

    Attributes
    ----------
    view : (H, W) int8 array
        Index of the view; NO_VIEW where the pixel is dead.
    cause : (H, W) int8 array
        Index in CAUSES of a dead pixel; -1 where a view is.
    per_degree : (H, W) array
        Pixels per degree there; mirrors do not change it.
    parasites : dict
        Sequence of mirrors, joined by '>', or 'NAME alone', to its share of the frame, largest first.
    amid : dict
        The first few of these sequences to the pixel (u, v) deepest within those that follow it.
    step : int
    """

    view: NDArray[np.int8]
    cause: NDArray[np.int8]
    per_degree: Array
    parasites: dict[str, float]
    amid: dict[str, Array]
    step: int

    def share(self, index: int) -> float:
        """Share of the sensor that view number `index` has."""
        return float(np.mean(self.view == index))

    def dead(self) -> dict[str, float]:
        """Share of the sensor lost to each cause."""
        return {name: float(np.mean(self.cause == i)) for i, name in enumerate(CAUSES)}


def sensor_map(rig: Rig, body: Body, step: int = 1) -> SensorMap:
    """Trace the ray of every `step`-th pixel through all mirrors until it leaves or meets the camera."""
    rows, columns = range(0, rig.camera.height, step), range(0, rig.camera.width, step)
    shape = len(rows), len(columns)
    view, cause = np.full(shape, NO_VIEW, np.int8), np.full(shape, -1, np.int8)
    per_degree, strays = np.zeros(shape), dict[str, list[Array]]()
    names, tracer = list(rig.mirrors), _tracer(rig, body)
    for top in range(0, shape[0], _BAND):
        v, u = np.meshgrid(rows[top : top + _BAND], columns, indexing="ij")
        pixels = np.column_stack([u.ravel(), v.ravel()]).astype(np.float64)
        labels = rig.labels()[v, u].ravel()
        rays = rig.camera.ray(pixels)
        mirrors = tracer.trace(rays, BOUNCES).mirror
        at_camera: NDArray[np.bool_] = np.any(mirrors >= len(names), axis=0)
        causes = _causes(mirrors, at_camera)
        seen = (labels != NO_VIEW) & ~_camera_first(mirrors, labels, rig, len(names))
        causes[seen] = -1
        band = np.s_[top : top + _BAND]
        view[band] = np.where(seen, labels, NO_VIEW).reshape(v.shape)
        cause[band] = causes.reshape(v.shape)
        per_degree[band] = _per_degree(rig, pixels, rays).reshape(v.shape)
        stray = np.flatnonzero(causes == CAUSES.index(PARASITE))
        for sequence, followers in _sequences(mirrors[:, stray], names):
            strays.setdefault(sequence, []).append(pixels[stray[followers]])
    gathered = {sequence: np.vstack(parts) for sequence, parts in strays.items()}
    shares = {s: len(p) / view.size for s, p in sorted(gathered.items(), key=lambda e: -len(e[1]))}
    amid = {s: _deepest(gathered[s], rig.size, step) for s in list(shares)[:_NAMED]}
    return SensorMap(view, cause, per_degree, shares, amid, step)


def _tracer(rig: Rig, body: Body) -> Tracer:
    faces = [se3.transform(rig.T_rig_cam, face) for face in body_faces(body)]
    solid = [Mirror.from_polygon("camera", face) for face in faces]
    return Tracer([*rig.mirrors.values(), *solid], rig.T_rig_cam)


def _camera_first(
    mirrors: NDArray[np.int8], labels: NDArray[np.int8], rig: Rig, count: int
) -> NDArray[np.bool_]:
    """Tell which rays of views meet the camera before they have met their chain and left it."""
    lengths = np.array([len(view.mirrors) for view in rig.views.values()])[labels]
    at = mirrors >= count
    first = np.where(at.any(axis=0), at.argmax(axis=0), BOUNCES + 1)
    hidden: NDArray[np.bool_] = first <= lengths
    return hidden


def _causes(mirrors: NDArray[np.int8], at_camera: NDArray[np.bool_]) -> NDArray[np.int8]:
    causes = np.full(mirrors.shape[1], CAUSES.index(PARASITE), np.int8)
    causes[at_camera] = CAUSES.index(CAMERA)
    causes[mirrors[0] == LEAVES] = CAUSES.index(NO_MIRROR)
    causes[mirrors[0] == NOWHERE] = CAUSES.index(NO_RAY)
    return causes


def _deepest(pixels: Array, size: tuple[int, int], step: int) -> Array:
    """The pixel (2,) of a set (N, 2) that is farthest from all others of the frame."""
    inside = np.zeros((size[1] // step + 3, size[0] // step + 3), np.uint8)  # with a rim
    columns, rows = (pixels / step).astype(int).T + 1
    inside[rows, columns] = 1
    depth = cv2.distanceTransform(inside, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    deepest: Array = pixels[np.argmax(depth[rows, columns])]
    return deepest


def _sequences(mirrors: NDArray[np.int8], names: list[str]) -> list[tuple[str, NDArray[np.intp]]]:
    """Each distinct sequence of mirrors among rays (B, N), and the indices of those that follow it."""
    if not mirrors.shape[1]:
        return []
    # One number a ray is unique far faster than one row a ray.
    codes = (mirrors.astype(np.int64) + 2).T @ (len(names) + 2) ** np.arange(len(mirrors))
    _, first, counts = np.unique(codes, return_index=True, return_counts=True)
    followers = np.split(np.argsort(codes, kind="stable"), np.cumsum(counts)[:-1])
    rows = mirrors.T[first]
    words = [" > ".join(names[m] for m in row if m >= 0) for row in rows]
    words = [w if row[1] >= 0 else f"{w} alone" for w, row in zip(words, rows)]  # then past all others
    return [(w if row[-1] < 0 else f"{w} > ...", who) for w, row, who in zip(words, rows, followers)]


def _per_degree(rig: Rig, pixels: Array, rays: Array) -> Array:
    """Pixels a degree from the solid angle of each pixel: of neighbouring rays, by central differences."""
    half_x, half_y = np.array([0.5, 0.0]), np.array([0.0, 0.5])
    across = rig.camera.ray(pixels + half_x) - rig.camera.ray(pixels - half_x)
    along = rig.camera.ray(pixels + half_y) - rig.camera.ray(pixels - half_y)
    steradians = np.abs(np.einsum("ij,ij->i", np.cross(across, along), rays))
    known = (steradians > 1e-15) & rays.any(axis=1)
    dense: Array = np.where(known, math.radians(1.0) / np.sqrt(np.where(known, steradians, 1.0)), 0.0)
    return dense
