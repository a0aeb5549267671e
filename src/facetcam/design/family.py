"""From a drawing's parameters to a rig, and why some parameters make none."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from facetcam.design.cones import clip
from facetcam.design.optimal import longest_focal
from facetcam.design.spec import Body, CameraSpec, DesignSpec, Family
from facetcam.errors import RigError
from facetcam.geometry import se3
from facetcam.rig import Camera, Mirror, Rig, View
from facetcam.rig.camera import COEFFICIENTS
from facetcam.rig.frustum import at_height, face_names, inset, looking_at, regular_outline

Array = NDArray[np.float64]

_CLEARANCE = 1e-3  # metres between the lens and any mirror, at least
_ROUNDING = 1e-6
_MOST_FACES = 24
_LARGEST = 10.0  # metres
_FLATTEST = 1.0  # degrees between a facet and level, or upright


def make_rig(spec: DesignSpec) -> Rig:
    """Build and check the rig of a design.

    Raises
    ------
    RigError
        If the parameters cannot be built; one line that says which and why.
    """
    if spec.family is None:
        return Rig.load(str(spec.rig))
    rig = build(spec.family, spec.camera)
    check_built(rig, spec.family, spec.body)
    rig.check()
    return rig


def build(family: Family, camera: CameraSpec) -> Rig:
    """Build a rig of the family; refuses crossing facets and impossible sizes, but traces nothing."""
    _check_numbers(family)
    mirrors, views, centre = _folded(family) if family.fold else _upright(family)
    T_rig_cam = looking_at(centre, (0.0, 0.0, 0.0))
    first = {view.mirrors[0] for view in views.values()}
    corners = np.vstack([m.polygon for name, m in mirrors.items() if name in first and m.polygon is not None])
    return Rig(_camera(camera, T_rig_cam, corners), T_rig_cam, mirrors, views)


def check_built(rig: Rig, family: Family, body: Body) -> None:
    """Refuse a camera that stands in a mirror, or an opening that its rays do not fit through."""
    for name, mirror in rig.mirrors.items():
        if mirror.polygon is not None and _cuts(body_planes(rig, body), mirror.polygon):
            size = f"{body.width * 1e3:.0f} x {body.height * 1e3:.0f} x {body.depth * 1e3:.0f} mm"
            raise RigError(
                f"the camera's body ({size}) stands in mirror '{name}'; move the camera or shrink it"
            )
    if family.fold:
        _check_opening(rig, family)


def body_planes(rig: Rig, body: Body) -> Array:
    """Six half spaces (a, b, c, d), a x + b y + c z + d >= 0 inside, of the body in the rig frame."""
    x, y = body.width / 2, body.height / 2
    inside = np.array(
        [(1, 0, 0, x), (-1, 0, 0, x), (0, 1, 0, y), (0, -1, 0, y), (0, 0, -1, 0), (0, 0, 1, body.depth)],
        float,
    )
    planes: Array = inside @ se3.inverse(rig.T_rig_cam)
    return planes


def _cuts(planes: Array, polygon: Array) -> bool:
    corners = np.column_stack([polygon, np.ones(len(polygon))])
    for plane in planes:
        corners = clip(corners, plane)
    return len(corners) > 0


def _check_numbers(family: Family) -> None:
    for name in ("radius", "height", "aspect", "camera_height", "tilt_degrees"):
        value = getattr(family, name)
        if not (math.isfinite(value) and value > 0):
            raise RigError(f"family: {name} is {value:g}; it must be above zero and finite")
    for name in ("radius", "height", "camera_height"):
        if (value := getattr(family, name)) > _LARGEST:
            raise RigError(
                f"family: {name} is {value:g} m, no mirror's size; "
                f"give metres, {value / 1e3:g} for {value:g} mm"
            )
    if not 3 <= family.faces <= _MOST_FACES:
        raise RigError(f"family: 3 to {_MOST_FACES} faces make a rig, got {family.faces}")
    if not _FLATTEST <= family.tilt_degrees <= 90 - _FLATTEST:
        raise RigError(
            f"family: facets tilted by {family.tilt_degrees:g} degrees are none;"
            f" give {_FLATTEST:g} to {90 - _FLATTEST:g}"
        )
    if family.depth is not None and not family.depth > 0:
        raise RigError(f"family: facets of depth {family.depth:g} have no area; give a depth above zero")
    if family.depth is None and family.fold:
        raise RigError("family: folded facets leave an opening for the camera's rays; give their depth")


def _folded(family: Family) -> tuple[dict[str, Mirror], dict[str, View], Array]:
    assert family.depth is not None
    outline = base_outline(family)
    opening = inset(outline, family.depth)
    drop = family.depth * math.tan(family.tilt)
    if drop >= family.height:
        raise RigError(
            f"family: facets that come {drop * 1e3:.0f} mm down do not fit above a base"
            f" {family.height * 1e3:.0f} mm below; lower the tilt or the depth"
        )
    mirrors = {"base": Mirror.from_polygon("base", at_height(outline, 0.0))}
    faces = _faces(outline, family.height, opening, family.height - drop)
    views = {name: View(("base", name)) for name in faces}
    return mirrors | faces, views, np.array([0.0, 0.0, family.camera_height])


def _upright(family: Family) -> tuple[dict[str, Mirror], dict[str, View], Array]:
    outline = base_outline(family)
    to_tip = family.depth is None or family.depth >= family.radius * (1 - 1e-9)
    if to_tip and abs(family.aspect - 1.0) > 1e-9 and family.faces % 2 == 0:
        raise RigError("family: a pyramid of aspect other than 1 has no tip; give a depth below the radius")
    depth = family.radius if to_tip else family.depth
    assert depth is not None
    rise = depth * math.tan(family.tilt)
    if rise >= family.height - _CLEARANCE:
        raise RigError(
            f"family: the pyramid, {rise * 1e3:.0f} mm high, reaches the camera"
            f" {family.height * 1e3:.0f} mm above its foot; lower the tilt or raise the height"
        )
    inner = np.zeros((1, 2)) if to_tip else inset(outline, depth)
    faces = _faces(outline, 0.0, inner, rise)
    return faces, {name: View((name,)) for name in faces}, np.array([0.0, 0.0, family.height])


def base_outline(family: Family) -> Array:
    """Corners (N, 2) in metres of the base or of a pyramid's foot; an odd one is not stretched."""
    stretch = family.aspect if family.faces % 2 == 0 else 1.0
    return regular_outline(family.faces, family.radius) * (stretch, 1.0)


def _faces(outer: Array, z_outer: float, inner: Array, z_inner: float) -> dict[str, Mirror]:
    """One mirror an edge of the outline; where `inner` is one point all meet in a tip."""
    count = len(outer)
    mirrors = {}
    for i, name in enumerate(face_names(count)):
        edge = [i, (i + 1) % count]
        far_edge = edge[::-1] if len(inner) > 1 else [0]
        mirrors[name] = Mirror.from_polygon(
            name, np.vstack([at_height(outer[edge], z_outer), at_height(inner[far_edge], z_inner)])
        )
    return mirrors


def _camera(spec: CameraSpec, T_rig_cam: Array, corners: Array) -> Camera:
    distortion = spec.distortion if spec.distortion is not None else (0.0,) * COEFFICIENTS[spec.model]
    centre = (spec.width - 1) / 2, (spec.height - 1) / 2
    focal = spec.focal if spec.focal is not None else 0.5 * spec.width
    camera = Camera(spec.model, spec.width, spec.height, focal, focal, *centre, distortion)
    if spec.focal is not None:
        return camera
    focal = longest_focal(camera, se3.transform(se3.inverse(T_rig_cam), corners))
    return Camera(spec.model, spec.width, spec.height, focal, focal, *centre, distortion)


def _check_opening(rig: Rig, family: Family) -> None:
    """A camera above the facets' opening looks through it; its cone must fit."""
    assert family.depth is not None
    level = family.height - family.depth * math.tan(family.tilt)
    if family.camera_height <= level + _ROUNDING:
        return
    opening = np.abs(inset(base_outline(family), family.depth)).max(axis=0)
    base = np.abs(base_outline(family)).max(axis=0)
    sensor = np.array([rig.camera.width, rig.camera.height]) / 2 / np.array([rig.camera.fx, rig.camera.fy])
    cone = np.minimum(sensor, base / family.camera_height) * (family.camera_height - level)
    if np.any(cone > opening + _ROUNDING):
        have, need = (" x ".join(f"{2e3 * side:.0f}" for side in sides) for sides in (opening, cone))
        raise RigError(
            f"family: the opening of {have} mm is too small for the camera's cone, {need} mm wide there;"
            f" lower the camera below {level * 1e3:.0f} mm, or lower the depth"
        )


def parameters(family: Family) -> Mapping[str, str]:
    """The drawing in words, in the paper's names."""
    depth = "to the tip" if family.depth is None else f"{family.depth * 1e3:.1f} mm"
    rows = {
        "faces": str(family.faces),
        "radius": f"{family.radius * 1e3:.1f} mm",
        "tilt": f"{family.tilt_degrees:.2f}°",
        "height": f"{family.height * 1e3:.1f} mm",
        "depth of facets": depth,
    }
    if family.faces % 2 == 0:
        rows["aspect"] = f"{family.aspect:.3f}"
    return rows | ({"camera above base": f"{family.camera_height * 1e3:.1f} mm"} if family.fold else {})
