"""Rigs that are built in: the paper's folded rig, an upright pyramid, two mirrors over a table."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from facetcam.config import nearest
from facetcam.errors import RigError
from facetcam.geometry import se3
from facetcam.rig.camera import Camera
from facetcam.rig.frustum import at_height, face_names, inset, looking_at, pinhole, regular_outline
from facetcam.rig.mirrors import Mirror
from facetcam.rig.rig import Rig
from facetcam.rig.view import View

Array = NDArray[np.float64]

PREFIX = "preset:"

_SPARE = 0.95  # share of the sensor that a fitted focal length fills


def by_name(name: str) -> Rig:
    """Make a preset from its name: `ryu`, `pyramid` or `table`."""
    presets: dict[str, Callable[[], Rig]] = {"ryu": ryu, "pyramid": pyramid, "table": table}
    if name not in presets:
        raise RigError(f"{PREFIX}{name}: no such preset; {nearest(name, presets)}")
    return presets[name]()


def ryu(
    faces: int = 4,
    radius: float = 0.0675,
    tilt: float = math.radians(37.0),
    height: float = 0.125,
    depth: float = 0.06,
    aspect: float = 4.0 / 3.0,
    camera_height: float = 0.055,
    focal: float = 1250.0,
) -> Rig:
    """Make the paper's folded rig: the camera looks down on a base mirror, which shows it the facets above.

    The facets stand on an inverted frustum between the top plane and a smaller opening below it. The
    defaults are the paper's 180 x 135 x 125 mm.

    Parameters
    ----------
    faces : int
        Number of facets, three or more. Four are named front, left, back and right, others face1, face2, ...
        counter-clockwise seen from above, from the front.
    radius : float
        Metres from the axis to the line where the front facet meets the top plane.
    tilt : float
        Radians between a facet and the top plane.
    height : float
        Metres between the top plane and the base.
    depth : float
        Metres by which a facet reaches inwards, measured in the top plane.
    aspect : float
        Width of the outline by its length, front to back, for an even number of faces.
    camera_height : float
        Metres of the lens above the base.
    focal : float
        Focal length in pixels of the 1600 x 1200 camera.

    Raises
    ------
    RigError
        If the facets would cross each other or the base.
    """
    outline = regular_outline(faces, radius) * (aspect, 1.0)
    opening = inset(outline, depth)
    drop = depth * math.tan(tilt)
    if not 0.0 < drop < height:
        raise RigError(
            f"ryu: facets {drop * 1e3:.0f} mm deep do not fit above a base {height * 1e3:.0f} mm below"
        )
    mirrors = {"base": Mirror.from_polygon("base", at_height(outline, 0.0))}
    views = {}
    for i, name in enumerate(face_names(faces)):
        edge = [i, (i + 1) % faces]
        upper, lower = at_height(outline[edge], height), at_height(opening[edge[::-1]], height - drop)
        mirrors[name] = Mirror.from_polygon(name, np.vstack([upper, lower]))
        views[name] = View(("base", name))
    T_rig_cam = looking_at((0.0, 0.0, camera_height), (0.0, 0.0, 0.0))
    rig = Rig(pinhole(focal), T_rig_cam, mirrors, views)
    rig.check()
    return rig


def pyramid(
    faces: int = 4,
    radius: float = 0.08,
    tilt: float = math.radians(42.0),
    camera_height: float = 0.25,
) -> Rig:
    """Make an upright pyramid of mirrors under a camera that looks down on its tip; views are mirror images.

    Parameters
    ----------
    faces : int
        Number of mirrors, three or more; names as for `ryu`.
    radius : float
        Metres from the axis to the foot of a face.
    tilt : float
        Radians between a face and the ground; 45 degrees turns a ray down the axis to the horizon.
    camera_height : float
        Metres of the lens above the foot. The focal length is the longest that shows the whole pyramid.

    Raises
    ------
    RigError
        If the camera would not stand above the tip.
    """
    outline = at_height(regular_outline(faces, radius), 0.0)
    tip = np.array([0.0, 0.0, radius * math.tan(tilt)])
    if not 0.0 < tip[2] < camera_height:
        raise RigError(
            f"pyramid: the tip, {tip[2] * 1e3:.0f} mm high, must stand between the foot and the camera"
        )
    names = face_names(faces)
    mirrors = {
        name: Mirror.from_polygon(name, [outline[i], outline[(i + 1) % faces], tip])
        for i, name in enumerate(names)
    }
    T_rig_cam = looking_at((0.0, 0.0, camera_height), (0.0, 0.0, 0.0))
    camera = _fitted(T_rig_cam, outline)
    rig = Rig(camera, T_rig_cam, mirrors, {name: View((name,)) for name in names})
    rig.check()
    return rig


def table(angle: float = math.radians(90.0), width: float = 0.5, height: float = 0.4) -> Rig:
    """Make two upright mirrors that meet behind a table: a direct view, one in each mirror, two in both.

    Parameters
    ----------
    angle : float
        Radians between the mirrors.
    width, height : float
        Size of each mirror in metres; they stand on z = 0 and meet at the back (y > 0), in the rig's origin.

    Returns
    -------
    Rig
        Views direct, left, right, and left_right and right_left, whose rays meet the first named first.
    """
    up = (0.0, 0.0, height)
    mirrors = {}
    for name, side in (("left", -1.0), ("right", 1.0)):
        foot = width * np.array([side * math.sin(angle / 2), -math.cos(angle / 2), 0.0])
        mirrors[name] = Mirror.from_polygon(name, np.array([np.zeros(3), foot, foot + up, up]))
    chains = {"direct": (), "left": ("left",), "right": ("right",)}
    chains |= {"left_right": ("left", "right"), "right_left": ("right", "left")}
    reach = 2.0 * width
    T_rig_cam = looking_at((0.0, -reach, reach), (0.0, -0.3 * width, 0.3 * height))
    corners = np.vstack([mirror.polygon for mirror in mirrors.values() if mirror.polygon is not None])
    views = {name: View(chain) for name, chain in chains.items()}
    rig = Rig(_fitted(T_rig_cam, corners), T_rig_cam, mirrors, views)
    rig.check()
    return rig


def _fitted(T_rig_cam: Array, points: Array) -> Camera:
    """Camera with the longest focal length that keeps all points (N, 3) on the sensor, with some to spare."""
    in_camera = se3.transform(se3.inverse(T_rig_cam), points)
    unit = pinhole(1.0)
    reach = np.abs(in_camera[:, :2] / in_camera[:, 2:]).max(axis=0)
    return pinhole(_SPARE * float(min((unit.cx, unit.cy) / reach)))
