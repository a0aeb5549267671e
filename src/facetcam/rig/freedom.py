"""Rigs whose numbers may move: how far a drawing is off, and the rig after a step of its numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from facetcam.geometry import se3
from facetcam.rig.camera import BROWN_CONRADY, Camera
from facetcam.rig.covariance import GLASS, MOTIONS, Axes, RigCovariance
from facetcam.rig.mirrors import Glass, Mirror
from facetcam.rig.rig import Rig

Array = NDArray[np.float64]

# What a careful build leaves unknown of a drawing, one standard deviation.
TILT, SHIFT = math.radians(0.3), 3e-4
FOCAL, CENTRE = 5e-3, 3e-3  # share of the focal length, and of the frame's width

_DISTORTION = {True: ("k1", "k2", "p1", "p2", "k3"), False: ("k1", "k2", "k3", "k4")}


def tolerance(rig: Rig) -> RigCovariance:
    """What is open of a rig that was never calibrated: mirrors, focal length and principal point.

    A mirror through which every view looks is held, since moving it moves the whole rig.
    """
    chains = [set(view.mirrors) for view in rig.views.values()]
    common = set.intersection(*chains) if len(chains) > 1 else set()
    mirrors = sorted(set.union(*chains) - common)
    axes = {name: _axes(rig.mirrors[name]) for name in mirrors}
    lens = {
        "fx": FOCAL * rig.camera.fx,
        "fy": FOCAL * rig.camera.fy,
        "cx": CENTRE * rig.camera.width,
        "cy": CENTRE * rig.camera.width,
    }
    sigma = lens | {f"{m}: {word}": s for m in mirrors for word, s in zip(MOTIONS, (TILT, TILT, SHIFT))}
    covariance = np.diag(np.array(list(sigma.values())) ** 2)
    covariance[0, 1] = covariance[1, 0] = 0.99 * math.sqrt(covariance[0, 0] * covariance[1, 1])
    return RigCovariance(tuple(sigma), covariance, axes)


def moved(rig: Rig, known: RigCovariance, step: Array) -> Rig:
    """The rig after a step (P,) of the parameters of a covariance, which stays the same.

    Raises
    ------
    RigError
        If the step leads to a rig that cannot be.
    """
    steps = dict(zip(known.parameters, step.tolist()))
    axes = dict(known.axes)
    mirrors = dict(rig.mirrors)
    for name, own in known.axes.items():
        by = [steps.get(f"{name}: {word}", 0.0) for word in MOTIONS]
        if any(by):
            mirrors[name], axes[name] = _moved_mirror(name, rig.mirrors[name], own, by)
    for name, mirror in mirrors.items():
        if mirror.glass is not None:
            mirrors[name] = replace(mirror, glass=_moved_glass(mirror.glass, name, steps))
    kept = RigCovariance(known.parameters, known.matrix, axes)
    return replace(rig, camera=_moved_camera(rig.camera, steps), mirrors=mirrors, covariance=kept)


def _axes(mirror: Mirror) -> Axes:
    across = np.linalg.svd(mirror.normal[None])[2][1:]
    polygon = mirror.polygon
    pivot = mirror.offset * mirror.normal if polygon is None else polygon.mean(axis=0)
    return _as_axes(across[0], across[1], pivot)


def _as_axes(u: Array, v: Array, pivot: Array) -> Axes:
    (a, b, c), (d, e, f), (g, h, i) = (vector.tolist() for vector in (u, v, pivot))
    return Axes((a, b, c), (d, e, f), (g, h, i))


def _moved_camera(camera: Camera, steps: Mapping[str, float]) -> Camera:
    names = _DISTORTION[camera.model == BROWN_CONRADY]
    focal = {key: getattr(camera, key) + steps.get(key, 0.0) for key in ("fx", "fy", "cx", "cy")}
    distortion = tuple(value + steps.get(key, 0.0) for key, value in zip(names, camera.distortion))
    return replace(camera, **focal, distortion=distortion)


def _moved_glass(glass: Glass, name: str, steps: Mapping[str, float]) -> Glass:
    thickness, index = (steps.get(f"{name}: {word}", 0.0) for word in GLASS)
    return replace(glass, thickness=max(glass.thickness + thickness, 0.0), index=glass.index + index)


def _moved_mirror(name: str, mirror: Mirror, axes: Axes, by: list[float]) -> tuple[Mirror, Axes]:
    """The mirror turned about its pivot and shifted along its normal, and its axes now."""
    u, v, pivot = (np.array(vector) for vector in (axes.u, axes.v, axes.pivot))
    tilted = mirror.normal + by[0] * u + by[1] * v
    normal = tilted / np.linalg.norm(tilted)
    axis = np.cross(mirror.normal, normal)
    sine = float(np.linalg.norm(axis))
    turn = axis * (math.asin(min(sine, 1.0)) / sine if sine > 1e-15 else 1.0)
    R, shift = se3.exp([*turn, 0.0, 0.0, 0.0])[:3, :3], by[2] * normal
    if mirror.polygon is None:
        offset = mirror.offset - mirror.normal @ pivot + normal @ pivot + by[2]
        after = Mirror.from_plane(name, normal, float(offset))
    else:
        after = Mirror.from_polygon(name, (mirror.polygon - pivot) @ R.T + pivot + shift)
    return replace(after, glass=mirror.glass), _as_axes(R @ u, R @ v, pivot + shift)
