"""Rig files: what is written comes back, and every mistake is one clear line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from facetcam.errors import RigError
from facetcam.rig import Mirror, Rig, View, presets

TEXT = """
camera:
  {model: brown-conrady, width: 640, height: 480, fx: 500.0, fy: 500, cx: 319.5, cy: 239.5,
   distortion: [1e-3, 0, 0, 0, 0], T_rig_cam: [[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 0.5], [0, 0, 0, 1]]}
mirrors:
  floor: {polygon: [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]}
  wall: {plane: {normal: [0, 2, 0], offset: 4}}
views:
  up: {mirrors: [floor]}
"""


def load(tmp_path: Path, text: str) -> Rig:
    path = tmp_path / "rig.yaml"
    path.write_text(text)
    return Rig.load(path)


def test_a_rig_file_is_read(tmp_path: Path) -> None:
    rig = load(tmp_path, TEXT)
    assert rig.camera.distortion[0] == 0.001
    assert rig.mirrors["wall"].offset == 2.0
    np.testing.assert_array_equal(rig.mirrors["wall"].normal, [0, 1, 0])
    np.testing.assert_allclose(rig.T_rig_image("up")[:3, 3], [0, 0, -0.5])


@pytest.mark.parametrize("make", [presets.ryu, presets.pyramid, presets.table])
def test_save_and_load_keep_everything(tmp_path: Path, make: Callable[[], Rig]) -> None:
    rig = make()
    region = np.array([[0.25, 0.0], [1599.0, 0.0], [1599.0, 1199.0], [0.0, 1199.0]])
    views = {name: View(view.mirrors, region) for name, view in rig.views.items()}
    normals = np.random.default_rng(5).normal(size=(20, 3))
    walls = {f"wall{i}": Mirror.from_plane(f"wall{i}", n, 3.0 + i / 3) for i, n in enumerate(normals)}
    rig = Rig(rig.camera, rig.T_rig_cam, rig.mirrors | walls, views)
    path = tmp_path / "rig.yaml"
    rig.save(path)
    assert Rig.load(path).digest == rig.digest


def test_saving_never_replaces_a_file(tmp_path: Path) -> None:
    path = tmp_path / "rig.yaml"
    path.write_text("mine")
    with pytest.raises(RigError, match="exists already"):
        presets.ryu().save(path)
    assert path.read_text() == "mine"


def test_a_rotation_written_with_few_digits_is_taken_for_the_exact_one(tmp_path: Path) -> None:
    c, s = np.cos(0.3), np.sin(0.3)
    R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.diag([1.0, -1.0, -1.0])
    rows = ", ".join(f"[{x:.5f}, {y:.5f}, {z:.5f}, {t}]" for (x, y, z), t in zip(R, (0, 0, 0.5)))
    rig = load(tmp_path, TEXT.replace("[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 0.5]", rows))
    np.testing.assert_allclose(rig.T_rig_cam[:3, :3], R, atol=1e-5)
    np.testing.assert_allclose(rig.T_rig_cam[:3, :3] @ rig.T_rig_cam[:3, :3].T, np.eye(3), atol=1e-14)


def test_digest_tells_rigs_apart(tmp_path: Path) -> None:
    rig = load(tmp_path, TEXT)
    assert rig.digest == load(tmp_path, TEXT.replace("fy: 500,", "fy: 500.0,")).digest
    assert rig.digest != load(tmp_path, TEXT.replace("fy: 500,", "fy: 500.001,")).digest


MISTAKES = [
    ("fx: 500.0", "f_x: 500.0", "camera: unknown key 'f_x'; did you mean 'fx'"),
    ("mirrors:\n", "mirors:\n", "unknown key 'mirors'; did you mean 'mirrors'"),
    ("up: {mirrors", "up: {mirror", "view 'up': unknown key 'mirror'; did you mean 'mirrors'"),
    ("mirrors: [floor]", "mirrors: [flor]", "view 'up': no mirror 'flor' in the rig; did you mean 'floor'"),
    ("[1, 1, 0], [-1, 1, 0]]", "[1, 1, 0.1], [-1, 1, 0]]", "mirror 'floor': polygon is not flat"),
    ("[1, 1, 0], [-1, 1, 0]]", "[0, -1, 0]]", "mirror 'floor': the polygon has no area"),
    (
        "[1, 1, 0], [-1, 1, 0]]",
        "[1, 1, 0], [1, 1, 0], [-1, 1, 0]]",
        "two neighbouring corners of the polygon",
    ),
    ("[1, 1, 0], [-1, 1, 0]]", "[-1, 1, 0], [1, 1, 0]]", "mirror 'floor': the polygon has no area"),
    ("[1, 1, 0], [-1, 1, 0]]", "[0, 0, 0], [1, 1, 0], [-1, 1, 0]]", "mirror 'floor': polygon is not convex"),
    ("[[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]", "[[1, 0, 0], [0, 1, 0]]", "three or more corners"),
    ("polygon: [[-1, -1, 0]", "polygon: [[-1, -1]", "mirror 'floor': polygon[0]: expected 3 values, got 2"),
    ("normal: [0, 2, 0]", "normal: [0, 0, 0]", "mirror 'wall': plane takes a normal"),
    ("offset: 4", "offset: .inf", "mirrors: wall: plane: offset: a number beyond"),
    ("cx: 319.5", "cx: .nan", "camera: cx: must be finite"),
    ("cx: 319.5", "cx: '319.5'", "camera: cx: expected float, got '319.5'"),
    ("fx: 500.0", "fx: 1e300", "camera: fx: a number beyond 1e+09"),
    ("[1, -1, 0], [1, 1, 0]", "[1, -1e200, 0], [1, 1, 0]", "mirrors: floor: polygon: a number beyond"),
    ("cx: 319.5", "cx: yes", "camera: cx: expected float, got True"),
    ("width: 640", "width: 640.5", "camera: width: expected int"),
    ("width: 640", "width: 1", "camera: the size 1x480"),
    ("width: 640", "width: 64000000", "camera: the size 64000000x480"),
    ("cx: 319.5, ", "", "camera: missing key 'cx'"),
    ("model: brown-conrady", "model: fisheye", "camera: unknown model 'fisheye'"),
    ("[0, 0, -1, 0.5]", "[0, 0, -2, 0.5]", "T_rig_cam: not a rotation"),
    ("[0, 0, -1, 0.5]", "[0, 0, 1, 0.5]", "T_rig_cam: a mirror image"),
    ("[0, 0, 0, 1]]", "[0, 0, 1, 1]]", "last row [0, 0, 0, 1]"),
    ("[0, 0, 0, 1]]", "[0, 0, 1]]", "camera: T_rig_cam[3]: expected 4 values, got 3"),
    ("[0, 0, -1, 0.5]", "[0, 0, -1, -0.5]", "the camera stands behind mirror 'floor' or its rays pass it by"),
    ("mirrors: [floor]", "mirrors: [floor, floor]", "view 'up': no pixel sees the room through it"),
    ("mirrors: [floor]", "mirrors: []", "view 'up': no pixel sees the room through it; another mirror"),
    (
        "mirrors: [floor]",
        "mirrors: [floor], region: [[900, 0], [999, 0], [999, 99]]",
        "its region lies elsewhere",
    ),
    ("mirrors: [floor]", "mirrors: [floor], region: [[0, 0], [9, 9]]", "region takes three or more"),
    (
        "mirrors: [floor]",
        "mirrors: [floor], region: [[0, 0], [9, 9], [18, 18]]",
        "less than one pixel of area",
    ),
    ("mirrors: [floor]", "mirrors: floor", "view 'up': mirrors: expected a list"),
    ("  up:", "  ../up:", "view '../up': name it with letters"),
    (
        "[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]",
        "[-99, -1, 0], [99, -1, 0], [99, 1, 0], [-99, 1, 0]",
        "mirror 'floor' would be 198 m wide; give its corners in metres",
    ),
    ("  up: {mirrors: [floor]}", "  {}", "views: a rig takes 1 to 127 views"),
    (
        "wall: {plane:",
        "floor: {plane:",
        "not a usable YAML file (line 7, column 3: key 'floor' given twice)",
    ),
]


@pytest.mark.parametrize(("right", "wrong", "message"), MISTAKES)
def test_a_mistake_is_one_clear_line(tmp_path: Path, right: str, wrong: str, message: str) -> None:
    assert right in TEXT
    with pytest.raises(RigError) as caught:
        load(tmp_path, TEXT.replace(right, wrong, 1))
    line = str(caught.value)
    assert line.startswith(f"{tmp_path / 'rig.yaml'}: ")
    assert line.count("rig.yaml") == 1
    assert message in line
    assert "\n" not in line


@pytest.mark.parametrize(
    "text", ["", "[]", "camera", "a: [", "\x00", "camera: {}\nviews: {}", "views: 3\ncamera: 4"]
)
def test_what_is_no_rig_is_said_to_be_none(tmp_path: Path, text: str) -> None:
    with pytest.raises(RigError) as caught:
        load(tmp_path, text)
    assert "\n" not in str(caught.value)


def test_a_missing_file_or_preset_is_named(tmp_path: Path) -> None:
    with pytest.raises(RigError, match=r"absent\.yaml: cannot be read"):
        Rig.load(tmp_path / "absent.yaml")
    with pytest.raises(RigError, match="did you mean 'pyramid'"):
        Rig.load("preset:piramid")


def test_a_direct_view_left_no_pixel_by_unbounded_mirrors_is_told_what_to_do(tmp_path: Path) -> None:
    text = TEXT.replace(
        "polygon: [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]", "plane: {normal: [0, 0, 1], offset: 0}"
    )
    with pytest.raises(RigError, match="give the views regions"):
        load(tmp_path, text + "  direct: {mirrors: []}\n")
    regions = "  direct: {mirrors: [], region: [[0, 0], [300, 0], [300, 480], [0, 480]]}\n"
    up = "up: {mirrors: [floor], region: [[300, 0], [640, 0], [640, 480], [300, 480]]}"
    rig = load(tmp_path, text.replace("up: {mirrors: [floor]}", up) + regions)
    labels = rig.labels()
    assert labels[240, 100] == 1
    assert labels[240, 500] == 0
    assert rig.sees("direct", [[100, 240], [500, 240]]).tolist() == [True, False]


def test_a_region_covers_what_lies_inside_its_outline() -> None:
    rng = np.random.default_rng(2)
    angles = np.sort(rng.uniform(0, 2 * np.pi, 9))
    radii = rng.uniform(20, 100, 9)
    region = 120 + radii[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    pixels = rng.uniform(0, 240, (2000, 2))
    contour = region.astype(np.float32)[:, None]
    distances = np.array([cv2.pointPolygonTest(contour, (x, y), True) for x, y in pixels.tolist()])
    clear = abs(distances) > 1e-3
    np.testing.assert_array_equal(View((), region).covers(pixels)[clear], distances[clear] > 0)
