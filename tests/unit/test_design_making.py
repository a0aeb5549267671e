"""Templates and holders, read back by other libraries and judged by the rig itself."""

from __future__ import annotations

import io
import math
import re
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import ezdxf
import numpy as np
import pytest
import trimesh

from facetcam.design import extras
from facetcam.design.areas import view_areas
from facetcam.design.family import make_rig
from facetcam.design.holder import POST_RADIUS, holder, post_places, to_stl
from facetcam.design.spec import Body, CameraSpec, DesignSpec, Family, Making, read_spec
from facetcam.design.templates import bevels, parts_table, reflecting_side, templates, to_dxf, to_svg
from facetcam.errors import ConfigError, FacetcamError
from facetcam.rig import Mirror, Rig, presets

EXAMPLES = Path(__file__).parents[2] / "examples" / "designs"
PAPER = read_spec("preset:ryu")
PYRAMID = DesignSpec(family=Family(False, 5, 0.06, 40.0, 0.12, None), body=Body(0.02, 0.02, 0.015))
TRUNCATED = DesignSpec(family=Family(False, 6, 0.06, 45.0, 0.15, 0.03), body=Body(0.02, 0.02, 0.015))
INSIDE = replace(
    PAPER,
    family=Family(radius=0.06, height=0.06, depth=0.045, tilt_degrees=35, aspect=1.0, camera_height=0.04),
    camera=CameraSpec(focal=1250.0),
    body=Body(0.02, 0.02, 0.015),
)


def test_a_dxf_read_back_is_the_mirror_in_millimetres() -> None:
    rig = presets.ryu()
    for template in templates(rig, Making(kerf_mm=0.3)):
        document = ezdxf.read(io.StringIO(to_dxf(template, "a rig")))
        assert document.header["$INSUNITS"] == 4
        assert not document.audit().has_issues
        lines = {
            line.dxf.layer: np.array(line.get_points("xy"))
            for line in document.modelspace().query("LWPOLYLINE")
        }
        assert all(line.closed for line in document.modelspace().query("LWPOLYLINE"))
        polygon = rig.mirrors[template.name].polygon
        sides = np.linalg.norm(np.roll(polygon, -1, axis=0) - polygon, axis=1) * 1000
        found = np.linalg.norm(np.roll(lines["MIRROR"], -1, axis=0) - lines["MIRROR"], axis=1)
        assert sorted(found) == pytest.approx(sorted(sides), abs=1e-9)
        diagonal = np.linalg.norm(polygon[0] - polygon[2]) * 1000
        assert np.linalg.norm(lines["MIRROR"][0] - lines["MIRROR"][2]) == pytest.approx(diagonal, abs=1e-9)
        # The cut runs half a kerf outside every edge.
        for a, b in zip(lines["MIRROR"], np.roll(lines["MIRROR"], -1, axis=0)):
            outward = np.array([(b - a)[1], -(b - a)[0]]) / np.linalg.norm(b - a)
            assert ((lines["CUT"] - a) @ outward).max() == pytest.approx(0.15, abs=1e-9)
        words = [text.dxf.text for text in document.modelspace().query("TEXT")]
        assert template.name in words and any("FIRST SURFACE" in word for word in words)


def test_a_lopsided_mirror_is_drawn_from_the_side_that_reflects() -> None:
    polygon = [[0.0, 0.0, 0.5], [0.3, 0.0, 0.5], [0.3, 0.1, 0.5], [0.0, 0.4, 0.5]]
    plain = presets.pyramid()
    rig = Rig(
        plain.camera,
        np.eye(4),
        {"m": Mirror.from_polygon("m", polygon)},
        {"v": plain.views["front"].__class__(("m",))},
    )
    (template,) = templates(rig, Making())
    np.testing.assert_allclose(reflecting_side(rig, "m"), (0, 0, -1), atol=1e-12)
    # The camera at the origin looks along +z with x right and y down: it sees the long side on the left.
    corners = template.outline
    x, y = corners.T
    area = 0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1))
    assert area == pytest.approx(1000**2 * 0.3 * 0.25, rel=1e-9)
    # Turned face down, the outline would run the other way round: same lengths, opposite order.
    order = np.round(template.edges)
    seen = np.round([300, 400, math.hypot(300, 300), 100])  # top, left, slope, right: counter-clockwise
    start = int(np.argmax(order == seen[0]))
    assert np.roll(order, -start).tolist() == seen.tolist()


@pytest.mark.parametrize("name", ["paper", "five-face-pyramid", "stereo-adapter", "two-mirror-table"])
def test_every_svg_holds_its_mirror_point_by_point(name: str) -> None:
    rig = make_rig(read_spec(EXAMPLES / f"{name}.yaml"))
    found = templates(rig, Making(kerf_mm=0.2))
    assert {template.name for template in found} == set(rig.mirrors)
    for template in found:
        tree = ElementTree.fromstring(to_svg(template, name))
        cut, outline = (
            np.array([pair.split(",") for pair in re.findall(r"[-\d.]+,[-\d.]+", path.get("d", ""))], float)
            for path in tree.findall("{*}path")
        )
        size = [float(tree.get(side, "")[:-2]) for side in ("width", "height")]
        assert size == [float(n) for n in tree.get("viewBox", "").split()[2:]]  # one unit is a millimetre
        assert (cut >= 0).all() and (cut <= size).all()
        polygon = 1000 * rig.mirrors[template.name].polygon
        # All distances between corners, in one order or the other, are the drawing's.
        drawn = np.linalg.norm(polygon[:, None] - polygon, axis=2)
        flat = np.linalg.norm(outline[:, None] - outline, axis=2)
        assert any(np.allclose(flat, way, atol=1e-3) for way in (drawn, drawn[::-1, ::-1]))


def test_an_svg_is_true_to_size() -> None:
    (base, *_) = templates(presets.ryu(), Making(kerf_mm=0.0))
    tree = ElementTree.fromstring(to_svg(base, "<a & b>"))
    assert tree.get("width", "").endswith("mm")
    box = [float(n) for n in tree.get("viewBox", "").split()]
    assert float(tree.get("width", "")[:-2]) == pytest.approx(box[2])
    path = tree.findall("{*}path")[0].get("d", "")
    points = np.array([[float(n) for n in pair.split(",")] for pair in re.findall(r"[-\d.]+,[-\d.]+", path)])
    np.testing.assert_allclose(np.ptp(points, axis=0), (180, 135), atol=1e-3)
    assert "FIRST SURFACE" in "".join(tree.itertext()) and "<a & b>" in "".join(tree.itertext())


def test_the_bill_names_every_mirror_and_the_camera() -> None:
    rig = presets.pyramid(5)
    rows = parts_table(rig, templates(rig, Making()), Making())
    assert [row[0] for row in rows] == ["part", *(f"mirror face{i}" for i in range(1, 6)), "camera"]


def test_glass_of_neighbours_is_ground_to_meet() -> None:
    # Faces of a square pyramid at 45 degrees: normals (1, 0, 1) and (0, 1, 1) are 60 degrees apart.
    square = make_rig(replace(PYRAMID, family=Family(False, 4, 0.06, 45.0, 0.12, None, aspect=1.0)))
    for name in square.mirrors:
        ground = bevels(square, name)
        assert len(ground) == 2 and list(ground.values()) == pytest.approx([math.radians(30)] * 2)
    assert bevels(presets.ryu(), "base") == {}
    assert len(bevels(presets.ryu(), "front")) == 2
    for name in ("left", "right"):  # two mirrors that face each other
        assert bevels(presets.table(), name) == {}


@pytest.mark.parametrize("spec", [PAPER, PYRAMID, TRUNCATED, INSIDE])
@pytest.mark.parametrize("thickness", [0.0, 2.0])
def test_a_holder_is_watertight_and_carries_the_mirrors_in_their_planes(
    spec: DesignSpec, thickness: float
) -> None:
    rig = make_rig(spec)
    assert spec.family is not None
    solids = holder(rig, spec.family, spec.body, Making(thickness_mm=thickness))
    meshes = {
        name: trimesh.load(io.BytesIO(to_stl(solid)), file_type="stl") for name, solid in solids.items()
    }
    for mesh in meshes.values():
        assert mesh.is_watertight and mesh.is_winding_consistent and mesh.body_count == 1
        assert mesh.volume > 1000
    mesh = meshes["holder-facets"]
    for view in rig.views.values():
        mirror = rig.mirrors[view.mirrors[-1]]
        normal = reflecting_side(rig, view.mirrors[-1])
        heights = mesh.triangles_center @ normal - 1000 * normal @ mirror.polygon[0] + thickness
        face = (mesh.face_normals @ normal > 1 - 1e-6) & (np.abs(heights) < 2e-3)
        area = 1000**2 * np.linalg.norm(np.cross(*(mirror.polygon[1:3] - mirror.polygon[0]))) / 2
        assert mesh.area_faces[face].sum() > 0.6 * area
        # Where the mirror lies, nothing of the holder stands before its plane.
        inner = 1000 * (mirror.polygon.mean(axis=0) + 0.9 * (mirror.polygon - mirror.polygon.mean(axis=0)))
        before = inner + (0.05 - 0.0) * normal
        assert not mesh.contains(before).any()


@pytest.mark.parametrize("spec", [PAPER, PYRAMID])
def test_the_posts_stand_where_no_view_looks(spec: DesignSpec) -> None:
    rig = make_rig(spec)
    assert spec.family is not None
    bare = view_areas(rig)
    blocks = {}
    around = math.pi / 4 + np.arange(4) * math.pi / 2
    for i, (x, y) in enumerate(post_places(spec.family) / 1000):
        ring = np.stack(
            [
                x + math.sqrt(2) * POST_RADIUS / 1000 * np.cos(around),
                y + math.sqrt(2) * POST_RADIUS / 1000 * np.sin(around),
            ],
            axis=1,
        )
        for side in range(4):
            (ax, ay), (bx, by) = ring[side], ring[(side + 1) % 4]
            top = spec.family.height + 0.006  # with mirrors 3 mm thick and the plate
            wall = [[ax, ay, 0], [bx, by, 0], [bx, by, top], [ax, ay, top]]
            blocks[f"post{i}{side}"] = Mirror.from_polygon("post", wall)
    behind = view_areas(replace(rig, mirrors={**rig.mirrors, **blocks}))
    for name, area in bare.items():
        assert behind[name].solid_angle > 0.98 * area.solid_angle


def test_what_cannot_be_made_is_said() -> None:
    rig = make_rig(PAPER)
    assert PAPER.family is not None
    with pytest.raises(ConfigError, match="no room for a stem"):
        holder(rig, PAPER.family, PAPER.body, Making(thickness_mm=40.0))
    flat = replace(PYRAMID, family=replace(PYRAMID.family, tilt_degrees=10.0, depth=0.005))
    with pytest.raises(ConfigError, match="leave nothing behind"):
        holder(make_rig(flat), flat.family, flat.body, Making(thickness_mm=0.0))
    with pytest.raises(ConfigError, match="no bounded mirror"):
        templates(replace(rig, mirrors={}, views={"v": rig.views["front"].__class__()}), Making())
    with pytest.raises(ConfigError, match="kerf_mm is -1; it must be between 0 and 10"):
        Making(kerf_mm=-1.0)


def test_a_missing_library_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(extras, "find_spec", lambda name: None)
    with pytest.raises(FacetcamError, match=r"pip install facetcam\[design\]"):
        to_dxf(templates(presets.ryu(), Making())[0], "a rig")
