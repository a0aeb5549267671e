"""A rig as built: the drawing with errors of cutting, gluing and mounting."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from facetcam.geometry import se3
from facetcam.rig import Rig
from facetcam.rig.mirrors import Mirror
from facetcam.simulation.settings import BuildSettings

Array = NDArray[np.float64]


def built(rig: Rig, errors: BuildSettings, seed: int) -> Rig:
    """Draw a rig as it might have been built.

    Parameters
    ----------
    rig : Rig
        As drawn.
    errors : BuildSettings
    seed : int

    Returns
    -------
    Rig
        The same rig where all errors are zero.
    """
    if errors == BuildSettings():
        return rig
    rng = np.random.default_rng(seed)
    mirrors = {}
    for name, mirror in rig.mirrors.items():
        turn, shift = _drawn(rng, errors.tilt_degrees, errors.shift_mm)
        mirrors[name] = _moved(name, mirror, turn, shift)
    turn, shift = _drawn(rng, errors.camera_degrees, errors.camera_mm)
    focal = 1.0 + errors.focal_percent / 100 * rng.standard_normal()
    centre = errors.centre_pixels * rng.standard_normal(2)
    camera = rig.camera
    camera = replace(
        camera, fx=camera.fx * focal, fy=camera.fy * focal, cx=camera.cx + centre[0], cy=camera.cy + centre[1]
    )
    T = rig.T_rig_cam @ se3.exp([*turn, 0.0, 0.0, 0.0])
    T[:3, 3] = rig.T_rig_cam[:3, 3] + shift
    return Rig(camera, T, mirrors, rig.views)


def stated(drawn: Rig, true: Rig) -> dict[str, dict[str, float]]:
    """By how much each part is off: turn of a mirror's normal or the camera, and how far it moved.

    Returns
    -------
    dict
        For each mirror and `camera`: `turn_degrees` and `shift_mm`.
    """
    off = {}
    for name, mirror in drawn.mirrors.items():
        other = true.mirrors[name]
        turn = _angle(mirror.normal, other.normal)
        place = _middle(mirror)
        off[name] = {"turn_degrees": turn, "shift_mm": 1e3 * abs(float(place @ other.normal) - other.offset)}
    step = se3.inverse(drawn.T_rig_cam) @ true.T_rig_cam
    off["camera"] = {
        "turn_degrees": float(np.degrees(np.linalg.norm(se3.log(step)[:3]))),
        "shift_mm": 1e3 * float(np.linalg.norm(step[:3, 3])),
    }
    return off


def _drawn(rng: np.random.Generator, degrees: float, millimetres: float) -> tuple[Array, Array]:
    return np.radians(degrees) * rng.standard_normal(3), 1e-3 * millimetres * rng.standard_normal(3)


def _moved(name: str, mirror: Mirror, turn: Array, shift: Array) -> Mirror:
    """Turn a mirror about its middle, then move it."""
    R, middle = se3.exp([*turn, 0.0, 0.0, 0.0])[:3, :3], _middle(mirror)
    if mirror.polygon is not None:
        return Mirror.from_polygon(name, (mirror.polygon - middle) @ R.T + middle + shift)
    normal = R @ mirror.normal
    return Mirror.from_plane(name, normal, float(normal @ (middle + shift)))


def _middle(mirror: Mirror) -> Array:
    if mirror.polygon is None:
        return np.asarray(mirror.offset * mirror.normal)
    return np.asarray(mirror.polygon.mean(axis=0))


def _angle(one: Array, other: Array) -> float:
    # The normal of a polygon may come out with either sign.
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(one, other)), abs(float(one @ other)))))
