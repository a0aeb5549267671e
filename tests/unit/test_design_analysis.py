"""Wedges, seams, dead pixels and the best camera against formulas and rays."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from facetcam.design.analysis import analyse, gaps_of
from facetcam.design.family import make_rig
from facetcam.design.optimal import best_camera, first_mirror, longest_focal, on_axis_focal, unfolded_ends
from facetcam.design.seams import seam_band, wedge_angle, wedges
from facetcam.design.spec import Body, CameraSpec, DesignSpec, Family, Optics, read_spec
from facetcam.errors import RigError
from facetcam.geometry import se3
from facetcam.rig import Camera, Mirror, Rig, View, presets
from facetcam.rig.mirrors import Glass
from facetcam.viz.design_page import verdict
from facetcam.viz.rig_figures import ray_path

Array = NDArray[np.float64]
SIZE = (1600, 1200)


@pytest.mark.parametrize("make", [presets.ryu, presets.pyramid, lambda: presets.pyramid(5)])
def test_the_blind_wedge_is_what_rays_on_both_sides_of_an_edge_leave(make: object) -> None:
    assert callable(make)
    rig: Rig = make()
    found = wedges(rig)
    assert len(found) == len(rig.views)
    for wedge in found:
        assert wedge.blind
        one, other = wedge.views
        labels = rig.labels()
        # Neighbouring pixels of both views: their rays leave the mirrors as far apart as the formula says.
        a, b = labels == rig.view_names.index(one), labels == rig.view_names.index(other)
        v, u = np.nonzero(a[:, :-1] & b[:, 1:] | b[:, :-1] & a[:, 1:])
        pixels = np.column_stack([u + 0.5, v]).astype(float)
        first, second = (rig.ray(name, pixels)[1] for name in wedge.views)
        gaps = np.arccos(np.clip((first * second).sum(axis=1), -1, 1))
        assert wedge.angle.min() - 0.02 < gaps.min() and gaps.max() < wedge.angle.max() + 0.02
        np.testing.assert_allclose(np.ptp(gaps), np.ptp(wedge.angle), atol=0.06)


def test_wedge_formula_is_a_turn_by_twice_the_angle_between_the_facets() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        edge, ray, n1 = rng.normal(size=(3, 3))
        edge /= np.linalg.norm(edge)
        ray /= np.linalg.norm(ray)
        n1 = np.cross(edge, n1) / np.linalg.norm(np.cross(edge, n1))
        beta = rng.uniform(0.05, 1.5)
        n2 = n1 * math.cos(beta) + np.cross(edge, n1) * math.sin(beta)
        d1, d2 = (ray - 2 * (ray @ n) * n for n in (n1, n2))
        formula = wedge_angle(beta, np.array([math.acos(ray @ edge)]))[0]
        assert math.acos(np.clip(d1 @ d2, -1, 1)) == pytest.approx(formula, abs=1e-7)


def test_facing_mirrors_share_their_wedge() -> None:
    assert [wedge.blind for wedge in wedges(presets.table())] == [False]


def test_seam_band_of_a_web_camera() -> None:
    # 3.7 mm at f/2 over pixels of 2.8 um, an edge at 250 mm, focus far off.
    width = seam_band(1321.0, 1321.0 * 2.8e-6 / 2.0, np.array([0.25]), 1e9)
    assert width[0] == pytest.approx(9.77, abs=0.01)
    # A ray through the rim of the aperture meets the edge A / 2 beside the axis: similar triangles.
    assert width[0] == pytest.approx(1321.0 * (1321.0 * 2.8e-6 / 2.0) / 0.25, rel=1e-6)


def test_every_pixel_of_the_paper_s_rig_has_one_fate() -> None:
    rig = presets.ryu()
    found = analyse(rig, Body(), Optics(), step=2)
    used = sum(view.sensor_share for view in found.views.values())
    assert used + sum(found.sensor.dead().values()) == pytest.approx(1.0, abs=1e-12)
    assert set(found.sensor.parasites) == {"base alone"}
    # The pixel deepest within them: it hits the base and then passes all facets by.
    path = ray_path(rig, rig.camera.ray(found.sensor.amid["base alone"][None])[0], 1.0)
    assert len(path) == 3
    assert path[1][2] == pytest.approx(0.0, abs=1e-9)
    assert found.sensor.dead()["camera's own reflection"] > 0.02
    # Without a body in the way the views have the pixels that the rig says they have.
    bare = analyse(rig, Body(1e-4, 1e-4, 1e-4), Optics(), step=2)
    for index, view in enumerate(bare.views.values()):
        assert view.sensor_share == pytest.approx(np.mean(rig.labels()[::2, ::2] == index), abs=1e-4)
        assert not view.mirrored
    expected = max(
        np.linalg.norm(rig.T_rig_image(a)[:3, 3] - rig.T_rig_image(b)[:3, 3])
        for a in rig.views
        for b in rig.views
    )
    assert found.spread == pytest.approx(expected)


def test_the_field_of_view_of_a_plain_camera_is_its_own() -> None:
    T = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
    rig = Rig(Camera("brown-conrady", 200, 100, 100.0, 100.0, 99.5, 49.5, (0.0,) * 5), T)
    found = analyse(rig, Body(), Optics())
    view = found.views["front"]
    assert view.azimuth == pytest.approx((-math.pi / 4, math.pi / 4), abs=1e-9)
    assert view.elevation == pytest.approx((-math.atan(0.5), math.atan(0.5)), abs=1e-6)
    assert found.horizon == pytest.approx(0.25, abs=1e-3)
    assert view.solid_angle == pytest.approx(4 * math.asin(1 * 0.5 / math.sqrt(2 * 1.25)), rel=1e-12)
    assert view.per_degree[0] == pytest.approx(100 * math.radians(1), rel=1e-2)
    assert found.sphere == pytest.approx(view.solid_angle / (4 * math.pi), rel=0.02)


def test_glass_that_is_taken_for_thin_is_said() -> None:
    rig = presets.pyramid()
    through = {n: replace(m, glass=Glass(0.003, 1.52)) for n, m in rig.mirrors.items()}
    words = [verdict(analyse(replace(rig, mirrors=m), Body(), Optics(), 8)) for m in (rig.mirrors, through)]
    assert ["behind glass" in w for w in words] == [False, True]


def test_gaps_round_the_back() -> None:
    seen = np.zeros(360, dtype=bool)
    seen[170:190] = True
    ((start, end),) = gaps_of(seen)
    assert (math.degrees(start), math.degrees(end)) == pytest.approx((10, 350))
    assert gaps_of(~np.zeros(8, dtype=bool)) == [] and gaps_of(np.zeros(8, dtype=bool)) == [
        (-math.pi, math.pi)
    ]


class TestBestCamera:
    base = np.array([[-0.09, -0.0675, 0], [0.09, -0.0675, 0], [0.09, 0.0675, 0], [-0.09, 0.0675, 0]])
    camera = Camera("brown-conrady", *SIZE, 900.0, 900.0, 799.5, 599.5, (0.0,) * 5)

    def down(self, height: float) -> Array:
        T = np.diag([1.0, -1.0, -1.0, 1.0])
        T[2, 3] = height
        return T

    def test_the_paper_s_figure(self) -> None:
        found = best_camera(self.camera, self.base, self.down(0.125))
        assert found.focal == pytest.approx(1600 * 125 / 180, abs=0.01)
        assert on_axis_focal(0.180, 0.135, 0.125, SIZE) == pytest.approx(1111.11, abs=0.01)
        assert found.turned_from(self.down(0.125)) == pytest.approx(0.0, abs=1e-3)

    @pytest.mark.parametrize("seed", range(4))
    def test_no_orientation_found_by_chance_is_better(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        corners = self.base * rng.uniform(0.5, 1.5, (4, 1)) + rng.normal(0, 0.01, 3)
        T = self.down(0.2)
        found = best_camera(self.camera, corners, T)
        best = 0.0
        for twist in np.column_stack(
            [rng.uniform(-0.5, 0.5, (2000, 2)), rng.uniform(-math.pi, math.pi, 2000)]
        ):
            try:
                pose = T @ se3.exp([*twist, 0, 0, 0])
                best = max(best, longest_focal(self.camera, se3.transform(se3.inverse(pose), corners)))
            except RigError:
                continue
        assert best <= found.focal * (1 + 1e-6)
        # And what it found keeps every corner on the sensor, one of them on its very edge.
        at = Camera("brown-conrady", 1602, 1202, found.focal, found.focal, 800.5, 600.5, (0.0,) * 5)
        pixels, on = at.project(se3.transform(se3.inverse(found.T_rig_cam), corners))
        assert on.all()
        margin = np.minimum(pixels - 0.5, np.array([1600.5, 1200.5]) - pixels).min()
        assert margin == pytest.approx(0.0, abs=1e-3)

    def test_more_room_is_never_worse_and_higher_is_longer(self) -> None:
        box = (np.array([-0.02, -0.02, 0.1]), np.array([0.02, 0.02, 0.125]))
        wide = best_camera(self.camera, self.base, self.down(0.1), box)
        assert wide.focal >= 1600 * 125 / 180 - 0.01
        assert wide.T_rig_cam[2, 3] == pytest.approx(0.125, abs=1e-6)

    def test_distortion_counts(self) -> None:
        barrel = Camera("brown-conrady", *SIZE, 900.0, 900.0, 799.5, 599.5, (-0.15, 0.0, 0.0, 0.0, 0.0))
        points = se3.transform(se3.inverse(self.down(0.25)), self.base)
        focal = longest_focal(barrel, points)
        assert focal > longest_focal(self.camera, points)
        pixels, _ = Camera(
            "brown-conrady", 1604, 1204, focal, focal, 801.5, 601.5, barrel.distortion
        ).project(points)
        assert np.abs(pixels - (801.5, 601.5)).max(axis=0) == pytest.approx((800, 600), rel=0.01)

    def test_facets_are_seen_through_the_base(self) -> None:
        rig = presets.ryu()
        assert len(first_mirror(rig)) == 4
        ends = unfolded_ends(rig)
        assert ends[:, 2].max() < 0  # they appear below the base
        pixels, _ = rig.camera.project(se3.transform(se3.inverse(rig.T_rig_cam), ends))
        labels = rig.labels() >= 0
        v, u = np.nonzero(labels)
        assert pixels.min(axis=0) == pytest.approx((u.min(), v.min()), abs=1.0)
        assert pixels.max(axis=0) == pytest.approx((u.max(), v.max()), abs=1.0)


class TestFamily:
    def test_the_defaults_are_the_preset(self) -> None:
        built, preset = make_rig(read_spec("preset:ryu")), presets.ryu()
        np.testing.assert_allclose(built.T_rig_cam, preset.T_rig_cam, atol=1e-12)
        for name, mirror in preset.mirrors.items():
            np.testing.assert_allclose(built.mirrors[name].polygon, mirror.polygon, atol=1e-12)
        assert built.camera == preset.camera

    def test_a_pyramid_without_fold_is_the_preset(self) -> None:
        family = Family(False, 4, 0.08, 42.0, 0.25, None, 1.0)
        built, preset = make_rig(DesignSpec(family=family)), presets.pyramid()
        for name, mirror in preset.mirrors.items():
            np.testing.assert_allclose(built.mirrors[name].polygon, mirror.polygon, atol=1e-12)
        # The preset leaves 5 % of the sensor free and counts to the middle of the last pixel.
        assert preset.camera.fx == pytest.approx(0.95 * built.camera.fx * 1199 / 1200, rel=1e-9)

    @pytest.mark.parametrize(
        ("family", "camera", "message"),
        [
            (Family(depth=0.07), CameraSpec(), "cross each other"),
            (Family(tilt_degrees=80.0), CameraSpec(), "do not fit above a base"),
            (Family(tilt_degrees=95.0), CameraSpec(), "give 1 to 89"),
            (Family(radius=0.0), CameraSpec(), "above zero"),
            (Family(depth=0.0), CameraSpec(), "no area"),
            (Family(depth=None), CameraSpec(), "give their depth"),
            (Family(faces=2), CameraSpec(), "3 to 24 faces make a rig, got 2"),
            (Family(camera_height=0.079), CameraSpec(focal=1250.0), "stands in mirror"),
            (
                Family(tilt_degrees=20.0, camera_height=0.16),
                CameraSpec(focal=300.0),
                "too small for the camera",
            ),
            (Family(False, 4, 0.08, 42.0, 0.06, None, 1.0), CameraSpec(), "reaches the camera"),
            (Family(False, 4, 0.08, 42.0, 0.25, None, 1.3), CameraSpec(), "has no tip"),
            (Family(camera_height=0.005), CameraSpec(focal=8000.0), "no pixel sees the room"),
        ],
    )
    def test_what_cannot_be_is_refused(self, family: Family, camera: CameraSpec, message: str) -> None:
        with pytest.raises(RigError, match=message):
            make_rig(DesignSpec(family=family, camera=camera))


def test_a_body_before_the_only_view_is_said() -> None:
    camera = Camera("brown-conrady", 64, 48, 200.0, 200.0, 31.5, 23.5, (0.0,) * 5)
    facing = Mirror.from_polygon(
        "m", [[-0.02, -0.02, 0.1], [0.02, -0.02, 0.1], [0.02, 0.02, 0.1], [-0.02, 0.02, 0.1]]
    )
    rig = Rig(camera, np.eye(4), {"m": facing}, {"back": View(("m",))})
    with pytest.raises(RigError, match="body hides all of it"):
        analyse(rig, Body(0.2, 0.2, 0.02), Optics())
