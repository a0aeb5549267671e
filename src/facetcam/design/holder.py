"""A printable holder for pyramids and folded rigs: what carries the mirrors from behind, in millimetres.

Its parts stand where no view looks: behind the mirrors, in the shadow of the camera, and in the blind wedges
beyond the corners of the outline.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.spatial import HalfspaceIntersection

from facetcam.design.extras import need
from facetcam.design.family import base_outline
from facetcam.design.spec import Body, Family, Making
from facetcam.design.templates import reflecting_side
from facetcam.errors import ConfigError
from facetcam.rig import Rig
from facetcam.rig.frustum import inset

if TYPE_CHECKING:
    from manifold3d import Manifold

Array = NDArray[np.float64]

MM = 1000.0
PLATE = 3.0  # mm thick
POST_RADIUS, POST_GAP = 2.5, 1.5  # mm; the gap is to the corner of the outline
LUG = 2.0  # mm of plate round a post
PLAY = 0.15  # mm of a hole round its post
_ROUND = 48  # sides of a circle
_THINNEST = 2.0  # mm of a stem that still prints
_BITE, _SHY = 1.0, 0.02  # mm that the solid behind the facets enters its plate, and stays within its outline
_BLUNT = 0.1  # mm off the tip of a pyramid
_FINEST = 1e-3  # mm; what is finer is no detail but a sliver


def holder(rig: Rig, family: Family, body: Body, making: Making) -> dict[str, Manifold]:
    """Solids to print, by file name: a part with the faces for the mirrors, and one with plate and posts.

    The faces lie `thickness` behind the reflecting planes, so that first-surface mirrors glued onto them
    reflect where the drawing says.

    Raises
    ------
    ConfigError
        If the mirrors are too thick, or the opening too small, to leave anything to print.
    """
    need("manifold3d")
    outline = MM * base_outline(family)
    posts = [corner + (POST_RADIUS + POST_GAP) * _unit(corner) for corner in outline]
    thickness = making.thickness_mm
    back = thickness * math.cos(family.tilt)  # by which a facet's back edges lie beyond its front ones
    if family.fold:
        wide, lowest = (
            MM * family.height + back,
            MM * (family.height - _depth(family) * math.tan(family.tilt)),
        )
        core = _behind_facets(rig, thickness, outline, lowest, wide + _BITE)
        top = core + _plate(outline, posts, wide, PLATE, holes=True)
        top = _with_camera_room(top, rig, family, body, thickness)
        base = _plate(outline, posts, -thickness - PLATE, PLATE) + _posts(
            posts, -thickness - PLATE, wide + PLATE
        )
        return {"holder-facets": top, "holder-base": base}
    rise = MM * _depth(family) * math.tan(family.tilt)
    # A blunt tip: many planes that meet in one point would leave slivers there.
    blunt = MM * family.radius * math.tan(family.tilt) - thickness / math.cos(family.tilt) - _BLUNT
    core = _behind_facets(rig, thickness, outline, -back - _BITE, min(rise - back, blunt))
    foot_level, height = -back - PLATE, MM * family.height
    foot = core + _plate(outline, posts, foot_level, PLATE) + _posts(posts, foot_level, height + PLATE)
    bridge = _plate(outline, posts, height, PLATE, holes=True)
    lens = 0.4 * MM * min(body.width, body.height)
    bridge = bridge - _cylinder(np.zeros(2), lens, height - 1.0, PLATE + 2.0)
    return {"holder-facets": foot, "holder-camera": bridge}


def to_stl(solid: Manifold) -> bytes:
    """Binary STL of a solid, in millimetres."""
    from manifold3d import Manifold

    # Joined anew after rounding to single precision, which makes one of corners that were two.
    mesh = Manifold(solid.to_mesh()).simplify(_FINEST).to_mesh()
    corners = np.asarray(mesh.vert_properties)[:, :3][np.asarray(mesh.tri_verts)].astype("<f4")
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    rows = np.zeros(len(corners), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("spare", "<u2")])
    rows["normal"], rows["corners"] = normals, corners
    return b"facetcam holder, millimetres".ljust(80) + np.uint32(len(rows)).tobytes() + rows.tobytes()


def post_places(family: Family) -> Array:
    """Centres (N, 2) of the posts in mm, beyond the corners of the outline."""
    return np.array(
        [corner + (POST_RADIUS + POST_GAP) * _unit(corner) for corner in MM * base_outline(family)]
    )


def _behind_facets(rig: Rig, thickness: float, outline: Array, low: float, high: float) -> Manifold:
    """The solid behind all facets, `thickness` behind their reflecting planes, between two heights."""
    from manifold3d import Manifold

    planes = [(0.0, 0.0, -1.0, low), (0.0, 0.0, 1.0, -high)]
    for start, end in zip(outline, np.roll(outline, -1, axis=0)):
        outward = _unit(np.array([end[1] - start[1], start[0] - end[0]]))
        planes.append((*outward, 0.0, _SHY - float(outward @ start)))
    for view in rig.views.values():
        name = view.mirrors[-1]
        normal = reflecting_side(rig, name)
        polygon = rig.mirrors[name].polygon
        assert polygon is not None
        planes.append((*normal, thickness - MM * float(normal @ polygon[0])))
    half_spaces = np.array(planes)
    # The largest ball that fits gives a point inside, or says that nothing is.
    columns = np.column_stack([half_spaces[:, :3], np.linalg.norm(half_spaces[:, :3], axis=1)])
    ball = linprog([0, 0, 0, -1], columns, -half_spaces[:, 3], bounds=[(None, None)] * 3 + [(0, None)])
    if not ball.success or ball.x is None or ball.x[3] < _THINNEST / 2:
        raise ConfigError(
            f"holder: facets as low as these, {thickness:g} mm thick, leave nothing behind them to print"
        )
    corners = HalfspaceIntersection(half_spaces, ball.x[:3]).intersections
    # Corners where more than three planes meet are given several times over.
    first = np.unique(corners.round(3), axis=0, return_index=True)[1]
    return Manifold.hull_points(corners[first])


def _with_camera_room(top: Manifold, rig: Rig, family: Family, body: Body, thickness: float) -> Manifold:
    """A stem down to a camera below the opening, or a shaft for one that stands in it."""
    from manifold3d import Manifold

    level = MM * (family.height - _depth(family) * math.tan(family.tilt))
    opening = MM * np.abs(inset(base_outline(family), _depth(family))).max(axis=0)
    back, half = MM * (family.camera_height + body.depth), MM * np.array([body.width, body.height]) / 2
    if back <= level:
        room = opening - thickness / math.sin(family.tilt)
        stem = np.minimum(0.8 * half, room)
        if stem.min() < _THINNEST:
            raise ConfigError("holder: the opening leaves no room for a stem to the camera; lower the depth")
        return top + _box(stem, back, level + 1.0)
    front = MM * family.camera_height
    above = [(sx * (half[0] + 0.5), sy * (half[1] + 0.5), front) for sx in (-1, 1) for sy in (-1, 1)]
    wide = np.minimum(opening, half + 0.5)
    below = [
        (sx * o[0], sy * o[1], level - 1.0)
        for o in (np.maximum(opening, wide),)
        for sx in (-1, 1)
        for sy in (-1, 1)
    ]
    shaft = Manifold.hull_points(np.array(above + below)) + _box(
        half + 0.5, front, MM * family.height + thickness + PLATE + 1.0
    )
    return top - shaft


def _plate(outline: Array, posts: list[Array], z: float, thick: float, holes: bool = False) -> Manifold:
    """The outline as a plate, with a lug at each corner, its holes open for the posts."""
    from manifold3d import CrossSection, Manifold

    plate = Manifold.extrude(CrossSection([outline]), thick).translate((0.0, 0.0, z))
    for post in posts:
        inner = post - (POST_RADIUS + POST_GAP + LUG) * _unit(post)
        lug = _cylinder(post, POST_RADIUS + LUG, z, thick) + _cylinder(inner, POST_RADIUS, z, thick)
        plate = plate + lug.hull()
    if holes:
        for post in posts:
            plate = plate - _cylinder(post, POST_RADIUS + PLAY, z - 1.0, thick + 2.0)
    return plate


def _posts(posts: list[Array], low: float, high: float) -> Manifold:
    from manifold3d import Manifold, OpType

    return Manifold.batch_boolean(
        [_cylinder(post, POST_RADIUS, low, high - low) for post in posts], OpType.Add
    )


def _cylinder(centre: Array, radius: float, z: float, height: float) -> Manifold:
    from manifold3d import Manifold

    return Manifold.cylinder(height, radius, circular_segments=_ROUND).translate((*centre.tolist(), z))


def _box(half: Array, low: float, high: float) -> Manifold:
    from manifold3d import Manifold

    size = (2 * float(half[0]), 2 * float(half[1]), high - low)
    return Manifold.cube(size).translate((-float(half[0]), -float(half[1]), low))


def _depth(family: Family) -> float:
    return family.radius if family.depth is None else family.depth


def _unit(vector: Array) -> Array:
    unit: Array = vector / np.linalg.norm(vector)
    return unit
