"""Where views meet: the blind or shared wedge between them, and the band that a finite aperture blurs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from facetcam.design.areas import Area
from facetcam.design.spec import Optics
from facetcam.geometry import se3
from facetcam.rig import Rig

Array = NDArray[np.float64]

_SAMPLES = 101  # points along an edge
_SAME_CORNER = 1e-5  # metres between corners of two mirrors that share them
_INTO = 1e-3  # share of the way from an edge to the middle of a facet


@dataclass(frozen=True, slots=True)
class Wedge:
    """The wedge of directions between two views whose last mirrors share an edge.

    Attributes
    ----------
    views : pair of str
    beta : float
        Radians between the two mirrors' normals.
    theta : (N,) array
        Radians between the edge and the rays that the camera sends to it.
    angle : (N,) array
        Radians between the two reflections of each of these rays: 2 asin(sin beta sin theta).
    blind : bool
        True where neither view sees the wedge, False where both do.
    """

    views: tuple[str, str]
    beta: float
    theta: Array
    angle: Array
    blind: bool


@dataclass(frozen=True, slots=True)
class Seam:
    """The edges of a view's last mirror: distances (m) along the axis and blurred widths (pixels)."""

    view: str
    nearest: float
    farthest: float
    narrowest: float
    widest: float


def wedge_angle(beta: float, theta: Array) -> Array:
    """2 asin(sin beta sin theta): two reflections turn a ray by 2 beta about the edge."""
    angle: Array = 2.0 * np.arcsin(np.abs(np.sin(beta) * np.sin(theta)))
    return angle


def seam_band(f_px: float, aperture: float, z_edge: Array, z_focus: float) -> Array:
    """Width in pixels of the band where an aperture (m) mixes both sides of an edge at z_edge (m)."""
    width: Array = f_px * aperture * np.abs(1.0 / z_edge - 1.0 / z_focus)
    return width


def wedges(rig: Rig) -> list[Wedge]:
    """The wedges between all views whose chains differ in the last mirror only, where those share an edge."""
    found = []
    for a, b in combinations(rig.views, 2):
        chain_a, chain_b = rig.views[a].mirrors, rig.views[b].mirrors
        if chain_a and chain_b and chain_a[:-1] == chain_b[:-1] and chain_a[-1] != chain_b[-1]:
            edge = _shared_edge(rig, chain_a[-1], chain_b[-1])
            wedge = None if edge is None else _wedge(rig, (a, b), *edge)
            if wedge is not None:
                found.append(wedge)
    return found


def seams(rig: Rig, areas: dict[str, Area], optics: Optics) -> list[Seam]:
    """Width of the blurred band along the edges of each view's last mirror, where they bound the view."""
    found = []
    aperture = rig.camera.fx * optics.pixel_um * 1e-6 / optics.f_number
    for name, view in rig.views.items():
        polygon = rig.mirrors[view.mirrors[-1]].polygon if view.mirrors else None
        if polygon is None:
            continue
        points = _along(polygon, np.roll(polygon, -1, axis=0)).reshape(-1, 3)
        inner = points + _INTO * (polygon.mean(axis=0) - points)
        T_cam = se3.inverse(_before_last(rig, name))
        seen_inner = se3.transform(T_cam, inner)
        bounding = _contained(areas[name], seen_inner)
        z = se3.transform(T_cam, points)[bounding, 2]
        if len(z):
            width = seam_band(rig.camera.fx, aperture, z, optics.focus)
            extremes = (z.min(), z.max(), width.min(), width.max())
            found.append(Seam(name, *(float(value) for value in extremes)))
    return found


def _contained(area: Area, points_cam: Array) -> NDArray[np.bool_]:
    return area.sees((points_cam / np.linalg.norm(points_cam, axis=1, keepdims=True)) @ area.R.T)


def _before_last(rig: Rig, view: str) -> Array:
    """Pose of the virtual camera of all mirrors of a chain but the last."""
    T = rig.T_rig_cam
    for name in rig.views[view].mirrors[:-1]:
        T = rig.mirrors[name].reflection @ T
    return T


def _shared_edge(rig: Rig, a: str, b: str) -> tuple[Array, Array] | None:
    """The two corners that both mirrors have, farthest apart."""
    first, second = rig.mirrors[a].polygon, rig.mirrors[b].polygon
    if first is None or second is None:
        return None
    gaps = np.linalg.norm(first[:, None] - second[None], axis=2)
    common = first[gaps.min(axis=1) < _SAME_CORNER]
    return (common[0], common[1]) if len(common) == 2 else None


def _wedge(rig: Rig, views: tuple[str, str], start: Array, end: Array) -> Wedge | None:
    T = _before_last(rig, views[0])
    points = _along(start[None], end[None])[0]
    _, on_sensor = rig.camera.project(se3.transform(se3.inverse(T), points))
    if not on_sensor.any():
        return None
    rays = points[on_sensor] - T[:3, 3]
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    along = (end - start) / np.linalg.norm(end - start)
    one, other = (rig.mirrors[rig.views[name].mirrors[-1]] for name in views)
    cosine = abs(float(one.normal @ other.normal))
    beta = math.acos(min(1.0, cosine))
    theta = np.arccos(np.clip(rays @ along, -1.0, 1.0))
    return Wedge(
        views, beta, theta, wedge_angle(beta, theta), _is_blind(rig, views, points[on_sensor], T[:3, 3])
    )


def _is_blind(rig: Rig, views: tuple[str, str], points: Array, centre: Array) -> bool:
    """Whether a step into the first facet turns its rays away from those of the second."""
    one, other = (rig.mirrors[rig.views[name].mirrors[-1]] for name in views)
    assert one.polygon is not None
    inner = points + _INTO * (one.polygon.mean(axis=0) - points)
    at_edge, inside = (
        (p - centre) / np.linalg.norm(p - centre, axis=1, keepdims=True) for p in (points, inner)
    )
    first, second = at_edge @ one.reflection[:3, :3], at_edge @ other.reflection[:3, :3]
    step = inside @ one.reflection[:3, :3] - first
    return bool(np.einsum("ij,ij->i", step, second - first).sum() < 0)


def _along(starts: Array, ends: Array) -> Array:
    shares = np.linspace(0.0, 1.0, _SAMPLES)[:, None, None]
    points: Array = starts + shares * (ends - starts)
    return points.transpose(1, 0, 2)
