"""What the page of a design says of a rig in the units of a workshop: mm, degrees, percent."""

from __future__ import annotations

import math

import numpy as np

from facetcam.design.family import parameters
from facetcam.design.spec import DesignSpec
from facetcam.rig import Mirror, Rig

_ALL_ROUND = math.radians(359.5)
_UPRIGHT = math.radians(89.5)  # a camera that looks steeper looks to no side


def facts(rig: Rig, spec: DesignSpec) -> dict[str, str]:
    """The drawing: parameters of the family, or each mirror of a rig that is given as a file."""
    camera, body = rig.camera, spec.body
    found = {"rig": str(spec.rig)} if spec.family is None else dict(parameters(spec.family))
    found |= {
        "camera": f"{camera.width} x {camera.height}, {camera.model}",
        "focal length": f"{camera.fx:.1f} px",
        "camera's body": f"{body.width * 1e3:.0f} x {body.height * 1e3:.0f} x {body.depth * 1e3:.0f} mm",
    }
    if spec.family is not None:
        return found | {"mirrors": ", ".join(rig.mirrors)}
    found |= {"lens at x, y, z": place(rig.T_rig_cam[:3, 3]), "looks": direction(rig.T_rig_cam[:3, 2])}
    return found | {f"mirror {name}": mirror_words(mirror) for name, mirror in rig.mirrors.items()}


def mirror_words(mirror: Mirror) -> str:
    """Sides of a mirror in their order, and its glass."""
    if mirror.polygon is None:
        words = "unbounded"
    else:
        sides = np.linalg.norm(mirror.polygon - np.roll(mirror.polygon, -1, axis=0), axis=1)
        words = "sides " + ", ".join(f"{1e3 * side:.0f}" for side in sides) + " mm"
    glass = mirror.glass
    return words if glass is None else f"{words}, behind {1e3 * glass.thickness:.1f} mm of glass"


def direction(axis: np.ndarray) -> str:
    """Where an axis (3,) of the rig points, as seen from its front."""
    elevation = math.asin(float(np.clip(axis[2] / np.linalg.norm(axis), -1.0, 1.0)))
    level = f"{abs(math.degrees(elevation)):.0f}° {'down' if elevation < 0 else 'up'}"
    if abs(elevation) > _UPRIGHT:
        return "straight down" if elevation < 0 else "straight up"
    words = "level" if round(math.degrees(elevation)) == 0 else level
    return f"{words}, to azimuth {math.degrees(math.atan2(axis[0], axis[1])) + 0.0:.0f}°"


def place(point: np.ndarray) -> str:
    return ", ".join(f"{round(1e3 * c) + 0}" for c in point) + " mm"


def azimuths(ends: tuple[float, float]) -> str:
    """A stretch of azimuths with both ends from -180 to 180 degrees; 155 to -155 goes across the back."""
    if ends[1] - ends[0] > _ALL_ROUND:
        return "all round"
    if ends[0] >= -math.pi - 1e-9 and ends[1] <= math.pi + 1e-9:
        return degrees(ends)
    return degrees((math.remainder(ends[0], math.tau), math.remainder(ends[1], math.tau)))


def percent(share: float) -> str:
    return f"{100 * share:.1f} %"


def mm(metres: float) -> str:
    return f"{1e3 * metres:.0f} mm"


def degrees(ends: tuple[float, float]) -> str:
    return f"{math.degrees(ends[0]) + 0.0:.0f}° to {math.degrees(ends[1]) + 0.0:.0f}°"
