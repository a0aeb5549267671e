"""Scenes as people have them: glTF with lamps, maps and glow, millimetres, missing pictures, huge ones."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from command import Facetcam, only_line
from numpy.typing import NDArray
from simulated_rooms import HIGH, resized, room_quads

from facetcam.geometry import se3
from facetcam.io.trajectories import write_tum
from facetcam.rig import Rig
from facetcam.simulation.meshes import Material, quad, within_memory

trimesh = pytest.importorskip("trimesh", reason="pip install facetcam[sim]")

CHUNK = 0x4E4F534A  # "JSON"
DARK = "light: {ambient: [0, 0, 0], sky: [0, 0, 0], lamps: []}\n"
PLAIN = "camera: {samples: 1, blur: 0, noise: false, exposure: 1.0}\n"


@pytest.fixture
def studio(tmp_path: Path) -> Path:
    """A folder with a pinhole that looks along +y, where it stands, and settings without noise."""
    rig = resized(Rig.load("preset:ryu"), 0.05)
    upright = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
    Rig(rig.camera, upright).save(tmp_path / "rig.yaml")
    write_tum(tmp_path / "path.tum", np.array([0.0]), np.eye(4)[None])
    (tmp_path / "plain.yaml").write_text(PLAIN)
    (tmp_path / "dark.yaml").write_text(PLAIN + DARK)
    return tmp_path


def room(factor: float = 1.0, textured: bool = True, **material: Any) -> Any:
    """A room of trimesh; its walls have pictures, or their material alone."""
    from PIL import Image

    scene = trimesh.Scene()
    for corner, right, down, picture in room_quads():
        q = quad(corner * factor, right * factor, down * factor, Material(picture))
        texture = {"baseColorTexture": Image.fromarray(picture[::8, ::8])} if textured else {}
        made = trimesh.visual.material.PBRMaterial(metallicFactor=0.0, **texture, **material)
        visual = trimesh.visual.TextureVisuals(uv=q.uv * (1, -1) + (0, 1), material=made)
        scene.add_geometry(trimesh.Trimesh(q.vertices, q.faces, visual=visual, process=False))
    return scene


def written(path: Path, scene: Any, edit: Callable[[dict[str, Any]], None] = lambda content: None) -> Path:
    """Write a .glb file after an edit of its JSON."""
    data = scene.export(file_type="glb")
    length = struct.unpack("<I", data[12:16])[0]
    content = json.loads(data[20 : 20 + length])
    edit(content)
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + length :]
    header = b"glTF" + struct.pack("<II", 2, 20 + len(text) + len(rest))
    path.write_bytes(header + struct.pack("<II", len(text), CHUNK) + text + rest)
    return path


def filmed(
    studio: Path, facetcam: Facetcam, scene: Path, settings: str, *more: object
) -> tuple[NDArray[np.uint8], str]:
    """The first frame, BGR, and what was said."""
    out = studio / f"out-{len(list(studio.glob('out-*')))}"
    command = ["simulate", scene, "--rig", studio / "rig.yaml", "--trajectory", studio / "path.tum"]
    result = facetcam(*command, "--settings", studio / settings, "--png", "--out", out, *more)
    assert result.exit_code == 0, result.output
    image = cv2.imread(str(out / "frames" / "000000.png"))
    assert image is not None
    return np.asarray(image, dtype=np.uint8), " ".join(result.stderr.split())


def test_its_own_lamps_shine_where_the_settings_name_none(studio: Path, facetcam: Facetcam) -> None:
    near = [0.9, 1.2, 0.0]

    def lit(content: dict[str, Any]) -> None:
        lights = [
            {"type": "point", "intensity": 40.0, "color": [0.0, 0.0, 1.0]},
            {"type": "directional"},
        ]
        content["extensionsUsed"] = ["KHR_lights_punctual"]
        content["extensions"] = {"KHR_lights_punctual": {"lights": lights}}
        for index, place in enumerate((near, [0.0, 0.0, 0.0])):
            node = {
                "name": f"lamp{index}",
                "translation": place,
                "extensions": {"KHR_lights_punctual": {"light": index}},
            }
            content["nodes"].append(node)
            content["nodes"][0].setdefault("children", []).append(len(content["nodes"]) - 1)

    scene = written(studio / "lit.glb", room(textured=False, baseColorFactor=(255, 255, 255, 255)), lit)
    (studio / "lamp.yaml").write_text(
        PLAIN.replace("1.0}", "0.1}") + "light: {ambient: [0, 0, 0], sky: [0, 0, 0]}\n"
    )
    image, said = filmed(studio, facetcam, scene, "lamp.yaml")
    assert "lit.glb: 1 lights without a place (suns) are left out" in said
    assert "the scene's own 1 shine" in said
    assert image[..., 1:].max() == 0  # the lamp is blue
    row, column = np.unravel_index(np.argmax(cv2.blur(image[..., 0], (5, 5))), image.shape[:2])
    camera = Rig.load(studio / "rig.yaml").camera
    # It hangs 0.4 m before the wall at +y, so the wall is brightest behind it.
    expected = camera.project([[near[0], -near[2], HIGH[1]]])[0][0]
    assert (column, row) == pytest.approx(expected, abs=3)


def test_emission_has_a_picture_of_its_own(studio: Path, facetcam: Facetcam) -> None:
    from PIL import Image

    half = np.zeros((8, 8, 3), np.uint8)
    half[:, :4] = (255, 128, 0)
    scene = room(
        baseColorFactor=(0, 0, 0, 255), emissiveFactor=(1.0, 1.0, 1.0), emissiveTexture=Image.fromarray(half)
    )
    image, _ = filmed(studio, facetcam, written(studio / "glow.glb", scene), "dark.yaml")
    seen = {tuple(int(c) for c in image[y, 40]) for y in (10, 50)}  # the picture is split across
    assert seen == {(0, 128, 255), (0, 0, 0)}


def test_colours_of_corners_tint_what_is_seen(studio: Path, facetcam: Facetcam) -> None:
    corner, right, down = np.array([-2.0, 2.0, 1.5]), np.array([4.0, 0, 0]), np.array([0, 0, -3.0])
    q = quad(corner, right, down, Material(np.zeros((1, 1, 3), np.uint8)))
    colours = np.array([[255, 0, 0, 255], [0, 255, 0, 255], [0, 255, 0, 255], [255, 0, 0, 255]], np.uint8)
    mesh = trimesh.Trimesh(q.vertices, q.faces, vertex_colors=colours, process=False)
    scene = written(studio / "tinted.glb", trimesh.Scene([mesh]))
    (studio / "day.yaml").write_text(PLAIN + "light: {ambient: [1, 1, 1], lamps: []}\n")
    image, said = filmed(studio, facetcam, scene, "day.yaml")
    assert "no texture" not in said
    camera = Rig.load(studio / "rig.yaml").camera
    x = np.array([-0.5, 0.0, 0.5])
    pixels = camera.project(np.column_stack([x, 0 * x, np.full(3, 2.0)]))[0]
    for place, pixel in zip(x, pixels):
        _, green, red = image[round(pixel[1]), round(pixel[0])] / 255.0
        assert green**2 / (red**2 + green**2) == pytest.approx((place + 2) / 4, abs=0.02)


def test_what_is_not_simulated_is_said_in_one_line(studio: Path, facetcam: Facetcam) -> None:
    from PIL import Image

    bumpy = room(normalTexture=Image.fromarray(np.full((4, 4, 3), 128, np.uint8)))

    def unlit(content: dict[str, Any]) -> None:
        content["extensionsUsed"] = ["KHR_materials_unlit", "KHR_texture_transform"]
        content["animations"] = [{"channels": [], "samplers": []}]

    _, said = filmed(studio, facetcam, written(studio / "bumpy.glb", bumpy, unlit), "plain.yaml")
    assert (
        "bumpy.glb: not simulated: normal maps (6 materials), animations, KHR_materials_unlit, "
        "KHR_texture_transform" in said
    )


def test_millimetres_and_flat_colours_are_said(studio: Path, facetcam: Facetcam) -> None:
    small, _ = filmed(studio, facetcam, written(studio / "m.glb", room()), "plain.yaml")
    image, said = filmed(studio, facetcam, written(studio / "mm.glb", room(1000.0)), "plain.yaml")
    assert "mm.glb: 3200 units long, so they are taken for millimetres; --scale 1 keeps metres" in said
    assert np.abs(image.astype(int) - small).max() <= 2
    bare = written(studio / "bare.glb", room(textured=False))
    assert (
        "bare.glb: 6 of 6 meshes have no texture; shown in a flat colour"
        in filmed(studio, facetcam, bare, "plain.yaml")[1]
    )


def test_a_missing_picture_is_said(studio: Path, facetcam: Facetcam) -> None:
    for name, data in room().export(file_type="gltf").items():
        (studio / name).write_bytes(data)
    scene = studio / "model.gltf"
    content = json.loads(scene.read_text())
    for image in content["images"]:
        image.pop("bufferView", None)
        image["uri"] = "lost.png"
    scene.write_text(json.dumps(content))
    _, said = filmed(studio, facetcam, scene, "plain.yaml")
    assert "model.gltf: texture lost.png and 5 more is missing; shown in a flat colour" in said


def test_files_that_an_obj_names_and_lacks_are_said(studio: Path, facetcam: Facetcam) -> None:
    scene = studio / "room.obj"
    scene.write_text(
        "mtllib the room.mtl\nusemtl a\nv 2 -2 0\nv 2 2 0\nv 2 2 3\nvt 0 0\nvt 1 0\nvt 1 1\nf 1/1 2/2 3/3\n"
    )
    assert "room.obj: materials the room.mtl is missing" in filmed(studio, facetcam, scene, "plain.yaml")[1]
    (studio / "the room.mtl").write_text("newmtl a\nmap_Kd lost wall.png\n")
    assert "room.obj: texture lost wall.png is missing" in filmed(studio, facetcam, scene, "plain.yaml")[1]


def test_a_scene_beyond_memory_is_refused_and_large_pictures_shrink(
    studio: Path, facetcam: Facetcam, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = written(studio / "room.glb", room())
    small = partial(within_memory, most=6 * 64 * 32)
    monkeypatch.setattr("facetcam.simulation.mesh_tables.within_memory", small)
    assert "4 textures are shown coarser" in filmed(studio, facetcam, scene, "plain.yaml")[1]
    monkeypatch.setattr("facetcam.simulation.meshes.MOST_TRIANGLES", 11)
    command = ["simulate", scene, "--rig", studio / "rig.yaml", "--trajectory", studio / "path.tum"]
    line = only_line(facetcam(*command, "--out", studio / "never"))
    assert "12 triangles; simplify it" in line
    assert not (studio / "never").exists()


def test_odd_paths_are_said_and_still_filmed(studio: Path, facetcam: Facetcam) -> None:
    places = [(0, 0, 0), (0, HIGH[1] - 0.005, 0), (0, HIGH[1] + 1.0, 0)]
    poses = np.array([se3.from_rotation_translation(np.eye(3), place) for place in places])
    write_tum(studio / "path.tum", np.arange(3) / 10, poses)
    _, said = filmed(studio, facetcam, written(studio / "room.glb", room()), "plain.yaml")
    assert "the path is outside the scene at 0.20 s" in said
    assert "the path passes through a surface at 0.10 s" in said
    assert "the rig stands in a wall, or within 2 cm of one, at 0.10 s" in said


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("empty.glb", b"", "empty.glb: empty file; export the scene again"),
        ("words.glb", b"a room, in words alone\n", "words.glb: not a glTF binary; export the scene as .glb"),
        ("cut.glb", b"glTF\2\0\0\0\0\1\0\0", "cut.glb: cut short, 12 of 256 bytes"),
        ("words.gltf", b"a room", "words.gltf: not a glTF text file"),
        ("lost.gltf", b'{"buffers": [{"uri": "lost.bin"}]}', "lost.gltf: lost.bin is missing"),
        ("empty.obj", b"", "empty.obj: empty file"),
    ],
)
def test_a_file_that_is_no_scene_is_refused_in_our_own_words(
    studio: Path, facetcam: Facetcam, name: str, content: bytes, says: str
) -> None:
    (studio / name).write_bytes(content)
    command = ["simulate", studio / name, "--rig", studio / "rig.yaml", "--trajectory", studio / "path.tum"]
    result = facetcam(*command, "--out", studio / "never")
    assert result.exit_code == 1
    assert says in only_line(result)
    assert not (studio / "never").exists()


@pytest.mark.parametrize(
    ("points", "says"),
    [
        ("x,y\n0,0\n", "two or more finite points, got 1"),
        ("x,y\n", "two or more finite points, got 0"),
        ("x,y\n0,0\nnan,1\n", "points.csv line 3: 'nan,1' is no place"),
        ("x,y\n0,0\n1e9,0\n", "1e+09 m at 0.75 m/s"),
        ("x,y\n0,0\n0,0\n1,2\n", "points 1 and 2 are one place"),
        ("x,y\n0,0\n1,east\n", "points.csv line 3: expected two numbers"),
    ],
)
def test_waypoints_that_make_no_path_are_refused(
    studio: Path, facetcam: Facetcam, points: str, says: str
) -> None:
    (studio / "points.csv").write_text(points)
    command = ["simulate", "room.glb", "--rig", studio / "rig.yaml", "--drive", studio / "points.csv"]
    assert says in only_line(facetcam(*command, "--out", studio / "never"))


def test_a_rig_without_views_is_refused(studio: Path, facetcam: Facetcam) -> None:
    rig = studio / "rig.yaml"
    rig.write_text(rig.read_text().split("views:")[0] + "views: {}\n")
    command = ["simulate", "room.glb", "--rig", rig, "--trajectory", studio / "path.tum"]
    assert "rig.yaml: views: a rig takes 1 to" in only_line(facetcam(*command, "--out", studio / "never"))
