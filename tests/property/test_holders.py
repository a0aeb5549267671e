"""Holders of odd drawings, read back by trimesh: closed solids whose seats lie where the mirrors will."""

from __future__ import annotations

import io

import numpy as np
import trimesh
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from facetcam.design.family import make_rig
from facetcam.design.holder import holder, to_stl
from facetcam.design.spec import Body, DesignSpec, Family, Making
from facetcam.design.templates import reflecting_side
from facetcam.errors import FacetcamError


@st.composite
def drawings(draw: st.DrawFn) -> DesignSpec:
    """Pyramids and folded rigs of a hand's to an arm's size, many of which cannot be built."""

    def between(low: float, high: float) -> float:
        return draw(st.floats(low, high, allow_subnormal=False))

    fold, radius = draw(st.booleans()), between(0.05, 0.3)
    height = radius * between(0.5, 4.0)
    to_tip = not fold and draw(st.booleans())
    family = Family(
        fold=fold,
        faces=draw(st.integers(3, 12)),
        radius=radius,
        tilt_degrees=between(10.0, 75.0),
        height=height,
        depth=None if to_tip else radius * between(0.1, 0.95),
        aspect=1.0 if to_tip else between(0.5, 2.0),
        camera_height=height * between(0.1, 0.95),
    )
    body = Body(between(0.005, 0.03), between(0.005, 0.03), between(0.005, 0.03))
    return DesignSpec(family=family, body=body, making=Making(draw(st.sampled_from([0.0, 1.1, 2.0, 3.0]))))


def area(polygon: np.ndarray) -> float:
    corners = polygon - polygon[0]
    return float(np.linalg.norm(np.cross(corners[1:-1], corners[2:]).sum(axis=0)) / 2)


@settings(max_examples=25, deadline=None, derandomize=True)
@given(drawings())
def test_holders_are_closed_solids_with_seats_behind_the_mirrors(spec: DesignSpec) -> None:
    assert spec.family is not None
    try:
        rig = make_rig(spec)
        solids = holder(rig, spec.family, spec.body, spec.making)
    except FacetcamError:  # a drawing that cannot be built, refused in one line
        assume(False)
    for name, solid in solids.items():
        mesh = trimesh.load(io.BytesIO(to_stl(solid)), file_type="stl")
        assert mesh.is_watertight and mesh.is_winding_consistent, name
        assert mesh.body_count == 1 and mesh.volume > 0, name
        if name != "holder-facets":
            continue
        for view in rig.views.values():
            mirror, normal = rig.mirrors[view.mirrors[-1]], reflecting_side(rig, view.mirrors[-1])
            behind = mesh.triangles_center @ normal - 1000 * mirror.polygon[0] @ normal
            level = np.abs(behind + spec.making.thickness_mm) < 2e-3
            seat = mesh.area_faces[level & (mesh.face_normals @ normal > 1 - 1e-6)].sum()
            assert seat > 0.8 * 1e6 * area(mirror.polygon), view
            # A mirror laid on its seat has all of the holder behind it, before its face and within its glass.
            middle = mirror.polygon.mean(axis=0)
            face = 1000 * (middle + 0.98 * (mirror.polygon - middle))
            depths = (-0.05, 0.05, 0.5 * spec.making.thickness_mm, spec.making.thickness_mm - 0.05)
            for depth in depths if spec.making.thickness_mm else depths[:1]:
                assert not mesh.contains(face - depth * normal).any(), (view, depth)
