"""Exact areas of views against counted pixels, rays traced by plain vectors, and conservation."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from facetcam.design import cones
from facetcam.design.areas import view_areas
from facetcam.design.family import build
from facetcam.design.spec import Body, CameraSpec, Family
from facetcam.design.unfolding import body_faces
from facetcam.geometry import se3
from facetcam.rig import Camera, Mirror, Rig, View, presets

Array = NDArray[np.float64]
SMALL = Body(0.025, 0.024, 0.02)


def counted(rig: Rig, step: int = 1) -> dict[str, float]:
    """Steradians of each view: its traced pixels, each with its own solid angle."""
    v, u = np.mgrid[0 : rig.camera.height : step, 0 : rig.camera.width : step]
    pixels = np.column_stack([u.ravel(), v.ravel()]).astype(float)
    rays = [rig.camera.ray(pixels + shift) for shift in ((0.5, 0.0), (-0.5, 0.0), (0.0, 0.5), (0.0, -0.5))]
    size = np.linalg.norm(np.cross(rays[0] - rays[1], rays[2] - rays[3]), axis=1) * step**2
    labels = rig.labels()[::step, ::step].ravel()
    return {name: float(size[labels == i].sum()) for i, name in enumerate(rig.views)}


def smaller(rig: Rig) -> Rig:
    """The same rig with half the pixels a side, which are quicker to count."""
    c = rig.camera
    halved = {key: (getattr(c, key) + 0.5) / 2 - 0.5 for key in ("cx", "cy")}
    camera = replace(c, width=c.width // 2, height=c.height // 2, fx=c.fx / 2, fy=c.fy / 2, **halved)
    return replace(rig, camera=camera)


def traced(faces: dict[str, Array], T_rig_cam: Array, rays: Array) -> list[tuple[str, ...]]:
    """Names of the faces that each ray meets, one ray at a time, without anything of the package."""
    out = []
    for ray in rays:
        origin, direction, path = T_rig_cam[:3, 3], T_rig_cam[:3, :3] @ ray, []
        while len(path) < 6:
            hits = [(hit(corners, origin, direction), name) for name, corners in faces.items()]
            way, name = min(h for h in hits if h[0] > 1e-9) if any(h[0] > 1e-9 for h in hits) else (0.0, "")
            if not name:
                break
            path.append(name)
            if name.startswith("camera"):
                break
            n = np.cross(faces[name][1] - faces[name][0], faces[name][2] - faces[name][0])
            n /= np.linalg.norm(n)
            origin, direction = origin + way * direction, direction - 2 * (direction @ n) * n
        out.append(tuple(path))
    return out


def hit(corners: Array, origin: Array, direction: Array) -> float:
    """Way to a convex polygon, -1 where the ray passes it by (Moeller-Trumbore on a fan)."""
    a = corners[0]
    for b, c in pairwise(corners[1:]):
        p = np.cross(direction, c - a)
        det = (b - a) @ p
        if abs(det) < 1e-15:
            continue
        t = origin - a
        q = np.cross(t, b - a)
        u, v = t @ p / det, direction @ q / det
        if u >= 0 and v >= 0 and u + v <= 1 and (c - a) @ q / det > 1e-9:
            return float((c - a) @ q / det)
    return -1.0


@pytest.mark.parametrize("make", [presets.ryu, presets.table, lambda: presets.ryu(5, radius=0.08), None])
def test_solid_angles_are_those_of_the_traced_pixels(make: object) -> None:
    lens = CameraSpec(model="kannala-brandt", distortion=(0.02, -0.004, 0.0, 0.0))
    rig = make() if callable(make) else build(Family(False, 5, 0.06, 40.0, 0.085, None), lens)
    rig = smaller(rig)
    truth = counted(rig)
    for name, area in view_areas(rig).items():
        assert area.solid_angle == pytest.approx(truth[name], rel=6e-3)


def test_barrel_distortion_bends_the_edge_of_the_sensor() -> None:
    rig = presets.ryu(focal=1800.0)
    bent = smaller(replace(rig, camera=replace(rig.camera, distortion=(-0.25, 0.08, 0.001, 0.0, 0.0))))
    truth = counted(bent)
    for name, area in view_areas(bent).items():
        assert area.solid_angle == pytest.approx(truth[name], rel=6e-3)


def test_the_body_hides_what_rays_traced_by_hand_say() -> None:
    rig = presets.ryu()
    faces = {name: mirror.polygon for name, mirror in rig.mirrors.items()}
    faces |= {f"camera{i}": se3.transform(rig.T_rig_cam, f) for i, f in enumerate(body_faces(SMALL))}
    rng = np.random.default_rng(3)
    pixels = rng.uniform((-0.5, -0.5), (rig.camera.width - 0.5, rig.camera.height - 0.5), (300, 2))
    rays = rig.camera.ray(pixels)
    paths = traced(faces, rig.T_rig_cam, rays)
    assert sum("camera" in path[-1] for path in paths) > 5
    for name, area in view_areas(rig, SMALL).items():
        seen = cones.contains(area.cones, rays)
        np.testing.assert_array_equal(seen, [path == ("base", name) for path in paths])


def test_a_flat_mirror_keeps_the_solid_angle() -> None:
    rig = presets.pyramid(6)
    for name, area in view_areas(rig).items():
        corners = se3.transform(se3.inverse(rig.T_rig_cam), rig.mirrors[name].polygon)
        assert area.solid_angle == pytest.approx(cones.solid_angle(corners), rel=1e-12)


def test_unbounded_mirrors_and_regions_divide_as_labels_do() -> None:
    camera = Camera("brown-conrady", 640, 480, 500.0, 500.0, 319.5, 239.5, (0.0,) * 5)
    T = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
    wall = {"wall": Mirror.from_plane("wall", (1.0, 0.0, 0.0), 0.4)}
    concave = np.array([[-0.5, -0.5], [500.0, -0.5], [250.0, 240.0], [500.0, 479.5], [-0.5, 479.5]])
    for views in (
        {"direct": View(), "mirrored": View(("wall",))},
        {"direct": View((), concave), "mirrored": View(("wall",))},
    ):
        rig = Rig(camera, T, wall, views)
        truth = counted(rig)
        for name, area in view_areas(rig).items():
            assert area.solid_angle == pytest.approx(truth[name], rel=4e-3, abs=1e-6), name


def test_an_area_with_a_hole_has_two_outlines() -> None:
    square = np.array([[-1.0, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]])
    left = cones.subtract(square, cones.walls(square * (0.3, 0.3, 1.0)))
    loops = cones.outlines(left)
    assert sorted(len(loop) for loop in loops) == [4, 4]
    outer = {tuple(np.round(c / c[2], 9)) for loop in loops for c in loop}
    assert outer == {(x, y, 1.0) for s in (1.0, 0.3) for x in (-s, s) for y in (-s, s)}


angles = st.floats(0.0, 2 * math.pi)


@st.composite
def convex_cones(draw: st.DrawFn) -> Array:
    around = sorted(draw(st.lists(angles, min_size=3, max_size=7)))
    gaps = np.diff([*around, around[0] + 2 * math.pi])
    x, y, size = draw(st.floats(-0.5, 0.5)), draw(st.floats(-0.5, 0.5)), draw(st.floats(0.2, 1.5))
    if gaps.min() < 0.05 or gaps.max() > 3.0:
        around = [0.1, 2.0, 4.0]
    return np.array([(x + size * math.cos(a), y + size * math.sin(a), 1.0) for a in around])


@settings(max_examples=60, deadline=None)
@given(convex_cones(), convex_cones())
def test_what_is_cut_and_what_is_left_make_up_the_whole(one: Array, other: Array) -> None:
    common = cones.intersect(one, cones.walls(other))
    left = cones.subtract(one, cones.walls(other))
    parts = sum(map(cones.solid_angle, left)) + (cones.solid_angle(common) if len(common) else 0.0)
    assert parts == pytest.approx(cones.solid_angle(one), rel=1e-9, abs=1e-10)
    rays = np.random.default_rng(0).normal(size=(200, 3)) * (0.5, 0.5, 0.0) + (0.0, 0.0, 1.0)
    inside_one, inside_other = cones.contains([one], rays), cones.contains([other], rays)
    np.testing.assert_array_equal(cones.contains(left, rays), inside_one & ~inside_other)
