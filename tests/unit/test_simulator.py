"""The simulator of triangle scenes against closed formulas, brute force, and itself on other threads."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from simulated_rooms import HIGH, LOW, glowing, resized, room_quads

from facetcam.config import load_config
from facetcam.errors import ConfigError, FacetcamError, SourceError
from facetcam.geometry import se3
from facetcam.rig import Rig, View
from facetcam.rig.camera import BROWN_CONRADY, Camera
from facetcam.simulation.build import built, stated
from facetcam.simulation.drive import Drive, SmoothPath, through
from facetcam.simulation.light import SCATTERED
from facetcam.simulation.meshes import Material, Mesh, joined, quad, within_memory
from facetcam.simulation.paths import RigPaths
from facetcam.simulation.scene import Lamp
from facetcam.simulation.settings import (
    BuildSettings,
    CameraSettings,
    LampSettings,
    SimulationConfig,
    Switch,
)

pytest.importorskip("trimesh", reason="pip install facetcam[sim]")

from facetcam import _core
from facetcam.simulation import embree
from facetcam.simulation.embree import EmbreeTree
from facetcam.simulation.exposures import Exposures, Sampling
from facetcam.simulation.mesh_renderer import MeshRenderer
from facetcam.simulation.path_checks import path_warnings
from facetcam.simulation.scene_files import read_scene
from facetcam.simulation.triangle_tree import HIT, TriangleTree

Array = NDArray[np.float64]
WHITE = np.full((4, 4, 3), 255, dtype=np.uint8)
UPRIGHT = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])  # looks along +y, z up


def pinhole(size: tuple[int, int] = (160, 120), focal: float = 110.0) -> Rig:
    width, height = size
    camera = Camera(BROWN_CONRADY, width, height, focal, focal, (width - 1) / 2, (height - 1) / 2, (0.0,) * 5)
    return Rig(camera, UPRIGHT, {}, {"direct": View()})


def wall(material: Material, size: float = 4.0, y: float = 2.0) -> Mesh:
    """A square that faces -y, centred on the y axis."""
    return quad(np.array([-size / 2, y, size / 2]), np.array([size, 0, 0]), np.array([0, 0, -size]), material)


def still(time: float) -> Array:
    return np.eye(4)


def shot(mesh: Mesh, rig: Rig | None = None, sky: float = 0.0, **settings: float) -> NDArray[np.float32]:
    camera = CameraSettings(**{"blur": 0.0, **settings})
    return Exposures(rig or pinhole(), MeshRenderer(mesh, sky=(sky,) * 3), camera).radiance(still, 0.0)


@pytest.fixture(params=[EmbreeTree, TriangleTree])
def tree(request: pytest.FixtureRequest) -> type[TriangleTree]:
    if request.param is EmbreeTree and not embree.installed():
        pytest.skip("pip install facetcam[sim]")
    return request.param


def test_a_tree_finds_the_triangle_that_trying_them_all_finds(tree: type[TriangleTree]) -> None:
    rng = np.random.default_rng(2)
    corners = (rng.uniform(-2, 2, (60, 1, 3)) + rng.uniform(-0.7, 0.7, (60, 3, 3))).astype(np.float32)
    start = rng.uniform(-2, 2, (800, 3)).astype(np.float32)
    aim = rng.standard_normal((800, 3))
    aim[::10, 0] = 0.0  # along a coordinate plane
    aim /= np.linalg.norm(aim, axis=1, keepdims=True)
    hits = tree(corners.reshape(-1, 3), np.arange(180).reshape(-1, 3), 2).trace(start, aim)
    a, b, c = corners.astype(float).transpose(1, 0, 2)
    nearest = np.full(800, np.inf)
    for k in range(60):
        M = np.stack(
            [np.broadcast_to(a[k] - b[k], aim.shape), np.broadcast_to(a[k] - c[k], aim.shape), aim], 2
        )
        u, v, t = np.linalg.solve(M, (a[k] - start)[..., None])[..., 0].T
        met = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
        nearest = np.where(met, np.minimum(t, nearest), nearest)
    assert 0.1 < np.isfinite(nearest).mean() < 0.9
    assert np.mean(np.isfinite(nearest) == np.isfinite(hits["distance"])) > 0.998  # edges may differ
    both = np.isfinite(nearest) & np.isfinite(hits["distance"])
    assert np.allclose(hits["distance"][both], nearest[both], rtol=1e-3, atol=1e-4)
    on = hits[both]
    place = a[on["surface"]] + on["u"][:, None] * (b - a)[on["surface"]]
    place += on["v"][:, None] * (c - a)[on["surface"]]
    assert np.allclose(place, start[both] + nearest[both, None] * aim[both], atol=2e-3)


def test_no_ray_slips_through_a_closed_skin(tree: type[TriangleTree]) -> None:
    """A fine sphere from inside, aimed at its edges and corners; piles of equal triangles in one place."""
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=4)
    vertices, faces = np.float32(ball.vertices), ball.faces
    made = tree(vertices, np.vstack([faces, np.tile(faces[:1], (500, 1))]), 2)
    middles = vertices[ball.edges_unique].mean(axis=1)
    aim = np.vstack([vertices, middles, vertices[faces].mean(axis=1)])
    hits = made.trace(np.zeros(3), aim / np.linalg.norm(aim, axis=1, keepdims=True))
    assert np.all(hits["surface"] >= 0)
    assert np.allclose(hits["distance"], 1.0, atol=0.005)


def test_the_core_refuses_tables_that_do_not_belong_together() -> None:
    corners, face = np.eye(3, dtype=np.float32), np.int32([[0, 1, 2]])
    with pytest.raises(ValueError, match="a corner that is not there"):
        _core.TriangleTree(corners, face + 1)
    with pytest.raises(ValueError, match="origins"):
        _core.TriangleTree(corners, face).cast(corners[:2], corners, 1)
    renderer = MeshRenderer(wall(Material(WHITE)))
    ray, hits = np.float32([[0, 1, 0]]), np.array([(7, 1.0, 0.5, 0.5)], HIT)
    with pytest.raises(ValueError, match="a surface that is not in the scene"):
        renderer._shader.shade(
            renderer.lighting(), ray, np.zeros(1, np.float32), hits.view(np.uint8).reshape(1, -1), 1e-3, 1
        )


@pytest.mark.parametrize("preset", ["preset:ryu", "preset:pyramid"])
def test_depth_through_mirrors_is_the_way_to_the_walls(preset: str) -> None:
    rig = resized(Rig.load(preset), 0.1)
    pose = se3.exp([0.1, -0.1, 0.4, 0.05, 0.1, -0.1])
    exposures = Exposures(rig, MeshRenderer(glowing(room_quads())), CameraSettings())
    depth, labels = exposures.depth(pose), rig.labels()
    for index, name in enumerate(rig.view_names):
        rows, columns = np.nonzero(labels == index)
        origin, rays = rig.ray(name, np.column_stack([columns, rows]).astype(float))
        world = rays @ pose[:3, :3].T
        start = se3.transform(pose, origin)
        expected = ((np.where(world > 0, HIGH, LOW) - start) / world).min(axis=1)
        assert np.allclose(depth[rows, columns], expected, rtol=1e-4)


def test_stray_light_goes_where_the_mirrors_send_it_or_nowhere() -> None:
    rig = resized(Rig.load("preset:ryu"), 0.1)
    renderer = MeshRenderer(glowing(room_quads()))
    stray = rig.labels() < 0
    real = Exposures(rig, renderer, CameraSettings(samples=1, blur=0.0)).radiance(still, 0.0)
    views = Exposures(rig, renderer, CameraSettings(samples=1, blur=0.0, stray=False)).radiance(still, 0.0)
    assert stray.any()
    assert np.all(real[stray].max(axis=1) > 0)  # a closed room: every way ends at a wall
    assert not views[stray].any()
    assert np.array_equal(real[~stray], views[~stray])
    body = Exposures(rig, renderer, CameraSettings(samples=1, blur=0.0, body=0.004)).radiance(still, 0.0)
    black = ~body.any(axis=2)
    assert black.any()
    assert np.all(stray[black])  # the camera sees itself in the base mirror, where no view is


def test_paths_end_where_the_rig_says_its_rays_go() -> None:
    rig = resized(Rig.load("preset:ryu"), 0.1)
    v, u = np.nonzero(rig.labels() == 2)
    pixels = np.column_stack([u, v]).astype(float)
    hops = RigPaths(rig).hops(pixels, np.zeros(2), 1.0, only_last=True)
    origin, rays = rig.ray(rig.view_names[2], pixels)
    assert len(hops) == 1
    assert np.allclose(hops[0].direction, rays, atol=1e-6)
    assert np.allclose(hops[0].start, origin + hops[0].travelled[:, None] * rays, atol=1e-6)


def test_what_stands_before_a_mirror_hides_it() -> None:
    rig = resized(Rig.load("preset:table"), 0.1)
    near = rig.T_rig_cam @ se3.from_rotation_translation(np.eye(3), [-0.5, -0.5, 0.05])
    card = quad(near[:3, 3], near[:3, 0], near[:3, 1], Material(WHITE, glow=1.0))
    depth = Exposures(rig, MeshRenderer(card), CameraSettings()).depth(np.eye(4))
    cosine = rig.camera.ray([[rig.camera.cx, rig.camera.cy]])[0, 2]
    middle = depth[round(rig.camera.cy), round(rig.camera.cx)]
    assert middle == pytest.approx(0.05 / cosine, rel=1e-3)


def test_light_follows_lamberts_law_on_both_sides() -> None:
    lamp = Lamp((0.3, 1.0, 0.2), 2.0, (1.0, 0.5, 0.25))
    behind = Lamp((0.0, 3.5, 0.0), 1.0)
    renderer = MeshRenderer(wall(Material(WHITE)), (lamp, behind))
    place = np.array([[0.5, 2.0, -0.4], [-0.6, 2.0, 0.1], [0.3, 2.0, 0.2]], dtype=np.float32)
    aim = place / np.linalg.norm(place, axis=1, keepdims=True)
    light, distance = renderer.look(0 * aim, aim, np.zeros(3, np.float32), 1e-3, renderer.lighting())
    towards = np.array(lamp.position) - place
    direct = 2.0 * -towards[:, 1] / np.linalg.norm(towards, axis=1) ** 3
    expected = (direct + SCATTERED * 2.0)[:, None] * [1.0, 0.5, 0.25] + SCATTERED
    assert np.allclose(light, expected, rtol=0.04)  # the lamp is a ball
    assert np.allclose(distance, np.linalg.norm(place, axis=1))


def test_opacity_shows_what_lies_behind_in_its_share() -> None:
    red, green = (np.full((4, 4, 3), c, np.uint8) for c in ((255, 0, 0), (0, 255, 0)))
    alpha = np.array([[255, 0], [64, 255]], np.uint8)
    front = wall(Material(red, alpha=alpha, glow=1.0), y=1.0)
    image = shot(joined([front, wall(Material(green, glow=1.0), size=9.0)]), samples=1)
    height, width = image.shape[:2]
    seen = {k: image[height * r // 4, width * c // 4] for k, (r, c) in enumerate([(1, 1), (1, 3), (3, 1)])}
    assert np.allclose(seen[0], (1, 0, 0), atol=0.01)
    assert np.allclose(seen[1], (0, 1, 0), atol=0.01)
    assert np.allclose(seen[2], (64 / 255, 1 - 64 / 255, 0), atol=0.01)
    masked = wall(Material(red, alpha=alpha, cutoff=0.5, glow=1.0), y=1.0)
    image = shot(joined([masked, wall(Material(green, glow=1.0), size=9.0)]), samples=1)
    assert np.allclose(image[height * 3 // 4, width // 4], (0, 1, 0), atol=0.01)


def test_samples_have_no_bias_and_lie_in_pixel_lens_and_exposure() -> None:
    settings = CameraSettings(samples=32, aperture=0.004, exposure_time=0.02)
    spread = Sampling.spread(settings)
    for values in (spread.pixel, spread.lens, spread.time[:, None]):
        assert np.allclose(values.mean(axis=0), 0.0, atol=1e-12)
    assert 0.4 < np.abs(spread.pixel).max() < 0.6
    assert 0.0018 < np.linalg.norm(spread.lens, axis=1).max() < 0.0022
    assert 0.009 < spread.time.max() <= 0.01


def test_lens_blurs_by_the_rule_of_the_thin_lens() -> None:
    """Width of the blur of an edge: f A |1/z - 1/focus|."""
    half = quad(
        np.array([0.0, 2.0, 5.0]), np.array([9.0, 0, 0]), np.array([0, 0, -10.0]), Material(WHITE, glow=1.0)
    )
    rig = pinhole((160, 24), focal=300.0)
    focus, aperture = 0.5, 0.02
    row = shot(half, rig, samples=64, aperture=aperture, focus=focus)[12, :, 0].astype(float)
    expected = 300.0 * aperture * abs(1 / 2.0 - 1 / focus)
    share = row[5:-5] / row[-6]
    # The profile of a disc has this standard deviation.
    x = np.arange(len(share) - 1)
    weight = np.diff(share)
    middle = (weight * x).sum() / weight.sum()
    deviation = np.sqrt((weight * (x - middle) ** 2).sum() / weight.sum())
    assert deviation == pytest.approx(expected / 4, rel=0.1)
    sharp = shot(half, rig, samples=64, aperture=aperture, focus=2.0)[12, :, 0]
    assert np.count_nonzero((sharp > 0.02) & (sharp < 0.98)) <= 2


def test_motion_smears_and_a_rolling_shutter_slants() -> None:
    half = quad(
        np.array([0.0, 2.0, 5.0]), np.array([9.0, 0, 0]), np.array([0, 0, -10.0]), Material(WHITE, glow=1.0)
    )
    speed, rig = 1.0, pinhole()  # 55 pixels a second

    def moving(time: float) -> Array:
        T = np.eye(4)
        T[0, 3] = speed * time
        return T

    renderer = MeshRenderer(half)
    smeared = Exposures(rig, renderer, CameraSettings(samples=16, blur=0.0, exposure_time=0.2))
    grey = np.count_nonzero((smeared.radiance(moving, 0.0)[60, :, 0] % 1.0) > 0.02)
    assert grey == pytest.approx(0.2 * 55, abs=2)
    rolled = Exposures(rig, renderer, CameraSettings(samples=4, blur=0.0, readout=0.4)).radiance(moving, 0.0)
    edge = (rolled[..., 0] < 0.5).sum(axis=1)
    assert edge[0] - edge[-1] == pytest.approx(0.4 * 55, abs=1.5)
    assert np.abs(np.diff(edge)).max() <= 1  # no steps between bands


def test_vignetting_is_the_fourth_power_of_the_cosine() -> None:
    flat = wall(Material(WHITE, glow=1.0), size=20.0)
    image = shot(flat, vignetting=1.0, samples=1)[..., 0]
    rays = pinhole().camera.ray([[0.0, 0.0], [80.0, 60.0]])
    assert image[[0, 60], [0, 80]] == pytest.approx(rays[:, 2] ** 4, rel=1e-4)


def test_frames_do_not_depend_on_threads() -> None:
    rig, mesh = resized(Rig.load("preset:ryu"), 0.1), glowing(room_quads())
    settings = CameraSettings(samples=3, aperture=0.002, exposure_time=0.02, readout=0.02)
    lamps = (Lamp((0.0, 0.0, 1.0), 1.0),)
    images = [
        Exposures(rig, MeshRenderer(mesh, lamps, threads=n), settings).radiance(
            lambda time: se3.exp([0, 0, time, time, 0, 0]), 0.1
        )
        for n in (1, 3)
    ]
    assert np.array_equal(*images)


def test_a_frame_is_the_same_without_embree(monkeypatch: pytest.MonkeyPatch) -> None:
    rig, room, lamp = resized(Rig.load("preset:ryu"), 0.2), room_quads(), Lamp((0.2, 0.1, 1.1), 1.0)
    mesh = joined([quad(c, r, d, Material(picture)) for c, r, d, picture in room])

    def frame(there: bool) -> NDArray[np.float32]:
        monkeypatch.setattr(embree, "installed", lambda: there)
        renderer = MeshRenderer(mesh, (lamp,))
        assert isinstance(renderer.tree, EmbreeTree) == there
        return Exposures(rig, renderer, CameraSettings()).radiance(still, 0.0)

    if not embree.installed():
        pytest.skip("pip install facetcam[sim]")
    difference = np.abs(frame(True) - frame(False))
    assert np.mean(difference > 1e-3) < 1e-3


def test_lamps_follow_their_switches() -> None:
    switches = (Switch(1.0, "off"), Switch(2.0, "dim", 0.3), Switch(3.0, "flicker"), Switch(5.0, "on"))
    lamp = LampSettings((0.0, 0.0, 1.0), schedule=switches).lamp(seed=1, until=9.0)
    assert [lamp.level(t) for t in (0.0, 0.99, 1.5, 2.5, 9.0)] == pytest.approx([1.0, 1.0, 0.0, 0.3, 1.0])
    flicker = [lamp.level(t) for t in np.arange(3.2, 5.0, 0.01)]
    assert np.ptp(flicker) > 0.4
    assert lamp == LampSettings((0.0, 0.0, 1.0), schedule=switches).lamp(seed=1, until=9.0)
    with pytest.raises(ConfigError, match="grow"):
        LampSettings((0.0, 0.0, 1.0), schedule=switches[::-1]).lamp(1, 9.0)


def test_the_settings_of_the_documentation_are_read(tmp_path: Path) -> None:
    page = Path(__file__).parents[2] / "docs" / "how-to" / "simulate.md"
    (tmp_path / "settings.yaml").write_text(page.read_text().split("```yaml")[1].split("```")[0])
    config = load_config(SimulationConfig, tmp_path / "settings.yaml")
    assert config.camera.samples == 8
    assert config.light.lamps is not None
    lamp = config.light.lamps[0].lamp(seed=0, until=20.0)
    assert [lamp.level(t) for t in (4.9, 6.0, 19.0)] == pytest.approx([1.0, 0.0, 0.3])


def test_a_built_rig_is_off_by_what_is_stated() -> None:
    rig = Rig.load("preset:ryu")
    assert built(rig, BuildSettings(), 1) is rig
    errors = BuildSettings(
        tilt_degrees=0.5, shift_mm=0.3, camera_degrees=0.2, camera_mm=0.2, focal_percent=0.5
    )
    true = built(rig, errors, 4)
    off = stated(rig, true)
    turns = [part["turn_degrees"] for part in off.values()]
    assert 0.05 < np.mean(turns) < 1.0
    for name, mirror in rig.mirrors.items():
        cosine = abs(mirror.normal @ true.mirrors[name].normal)
        assert off[name]["turn_degrees"] == pytest.approx(np.degrees(np.arccos(min(cosine, 1.0))), abs=1e-6)
    assert true.digest == built(rig, errors, 4).digest != built(rig, errors, 5).digest


def test_a_drive_goes_through_its_points_at_its_speed() -> None:
    points = np.array([[0.0, 0.0], [2.0, 0.0], [3.0, 1.0], [3.0, 3.0]])
    drive = through(points, fps=20, speed=0.5, height=0.8)
    place = drive.poses[:, :3, 3]
    assert np.allclose(place[:, 2], 0.8)
    assert all(np.linalg.norm(place[:, :2] - p, axis=1).min() < 0.03 for p in points)
    step = np.diff(place, axis=0)
    assert np.allclose(np.linalg.norm(step, axis=1), 0.5 / 20, rtol=0.01)
    front = drive.poses[:-1, :3, 1]
    assert np.einsum("ij,ij->i", front, step).min() > 0.99 * 0.5 / 20
    with pytest.raises(FacetcamError, match="two or more"):
        through(points[:1], 10)


@pytest.mark.parametrize("wrong", [{"speed": np.inf}, {"speed": np.nan}, {"height": np.nan}, {"fps": 1e12}])
def test_a_drive_that_is_none_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(FacetcamError, match="drive: "):
        through(np.array([[0.0, 0.0], [1.0, 0.0]]), **{"fps": 10.0, **wrong})


def test_odd_paths_are_said() -> None:
    renderer = MeshRenderer(glowing(room_quads()))

    def said(*places: tuple[float, float, float]) -> str:
        poses = np.array([se3.from_rotation_translation(np.eye(3), p) for p in places])
        return " / ".join(path_warnings(renderer, np.arange(len(poses)) / 10, poses))

    assert said((0, 0, 0), (0.1, 0, 0)) == ""
    assert "outside the scene" in said((0, 0, 0), (5, 0, 0))
    assert "through a surface at 0.00 s" in said((0, 0, 0), (5, 0, 0))
    assert "stands in a wall" in said((0, 0, 0), (0, HIGH[1] - 0.01, 0))


def export(folder: Path, factor: float = 1.0, step: int = 1) -> Path:
    import trimesh
    from PIL import Image

    scene = trimesh.Scene()
    for k, (corner, right, down, picture) in enumerate(room_quads()):
        q = quad(corner * factor, right * factor, down * factor, Material(picture))
        material = trimesh.visual.material.PBRMaterial(
            baseColorTexture=Image.fromarray(picture[::step, ::step])
        )
        visual = trimesh.visual.TextureVisuals(uv=q.uv * (1, -1) + (0, 1), material=material)
        if k == 0:
            visual = trimesh.visual.TextureVisuals(
                material=trimesh.visual.material.PBRMaterial(baseColorFactor=(255, 0, 0, 255))
            )
        scene.add_geometry(trimesh.Trimesh(q.vertices, q.faces, visual=visual, process=False))
    path = folder / "room.glb"
    scene.export(path)
    return path


def test_a_scene_file_comes_back_as_it_was(tmp_path: Path) -> None:
    read = read_scene(export(tmp_path))
    assert "1 of 6 meshes have no texture" in read.warnings[0]
    low, high = read.mesh.bounds
    assert np.allclose([low, high], [LOW, HIGH], atol=1e-5)
    mesh = replace(read.mesh, materials=tuple(replace(m, glow=1.0) for m in read.mesh.materials))
    one, other = (shot(m, samples=1) for m in (mesh, glowing(room_quads())))
    # The camera looks at the wall at +y, whose texture was kept.
    assert np.abs(one[40:80, 60:100] - other[40:80, 60:100]).max() < 0.01


def test_millimetres_are_noticed_and_said(tmp_path: Path) -> None:
    path = export(tmp_path, factor=1000.0, step=16)
    read = read_scene(path)
    assert any("millimetres" in text for text in read.warnings)
    assert np.allclose(read.mesh.bounds[1], HIGH, atol=1e-4)
    assert np.allclose(read_scene(path, scale=1.0).mesh.bounds[1], 1000 * HIGH, rtol=1e-5)
    up = read_scene(path, up="y").mesh
    assert np.allclose(up.bounds[1], [HIGH[0], -LOW[2], HIGH[1]], atol=1e-4)


@pytest.mark.parametrize("content", [b"", b"glTF", b"{}", b"not a scene at all"])
def test_a_broken_scene_is_refused_in_one_line(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "broken.glb"
    path.write_bytes(content)
    with pytest.raises(SourceError, match=r"broken\.glb") as caught:
        read_scene(path)
    assert "\n" not in str(caught.value)
    with pytest.raises(SourceError, match="no such"):
        read_scene(tmp_path / "absent.glb")


def test_too_many_triangles_and_texels_are_kept_out_of_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("facetcam.simulation.meshes.MOST_TRIANGLES", 3)
    with pytest.raises(FacetcamError, match="simplify"):
        joined([wall(Material(WHITE)), wall(Material(WHITE))])
    large, small = np.zeros((64, 64, 3), np.uint8), np.zeros((8, 8, 3), np.uint8)
    made, halved = within_memory([large, small], most=1200)
    assert [p.shape[:2] for p in made] == [(32, 32), (8, 8)]
    assert halved == 1


def test_a_standing_drive_has_lamps_and_frames() -> None:
    from facetcam.pipelines.simulate_inputs import hung_lamps

    one = Drive(np.zeros(1), np.eye(4)[None])
    assert np.array_equal(SmoothPath(one)(3.0), np.eye(4))
    assert len(hung_lamps(np.zeros((1, 3)), glowing(room_quads()))) == 1
    two = Drive(np.array([0.0, 1.0]), np.array([np.eye(4), se3.exp([0, 0, 1.0, 0, 0, 0])]))
    half = SmoothPath(two)(0.5)
    assert np.allclose(se3.log(half)[:3], [0, 0, 0.5])
