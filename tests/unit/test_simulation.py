"""The renderer against closed formulas: projections, distances, Lambert's law, shadows, filtering, noise."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from facetcam import _core
from facetcam.geometry import se3
from facetcam.rig import Rig, View, presets
from facetcam.rig.camera import BROWN_CONRADY, Camera
from facetcam.simulation.light import SCATTERED
from facetcam.simulation.materials import plain
from facetcam.simulation.rays import FrameRays
from facetcam.simulation.renderer import HIT, Renderer
from facetcam.simulation.scene import Lamp, Scene, Surface, box, placed
from facetcam.simulation.sensor import AutoExposure, Sensor

Array = NDArray[np.float64]

UPRIGHT = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])  # looks along +y, z up
LIGHT = Lamp((0.0, 0.0, 0.5), 1.0)


def pinhole(distortion: tuple[float, ...] = (0.0,) * 5) -> Rig:
    camera = Camera(BROWN_CONRADY, 320, 240, 220.0, 220.0, 159.5, 119.5, distortion)
    return Rig(camera, UPRIGHT, {}, {"direct": View()})


def wall(picture: NDArray[np.uint8], width: float = 2.0, height: float = 2.0, y: float = 2.0) -> Surface:
    """A picture that faces -y, centred on the y axis."""
    return Surface(
        np.array([-width / 2, y, height / 2]), np.array([width, 0, 0]), np.array([0, 0, -height]), picture
    )


def closed_room(low: Array, high: Array) -> Scene:
    """An empty box seen from inside."""
    walls = box(np.random.default_rng(0), low, high, plain((200, 200, 200)), without=())
    return Scene(tuple(replace(s, corner=s.corner + s.right, right=-s.right) for s in walls), (LIGHT,))


def chessboard(squares: int, texels: int) -> NDArray[np.uint8]:
    fields = np.indices((squares, squares)).sum(axis=0) % 2 * 200 + 40
    return np.repeat(fields.repeat(texels, 0).repeat(texels, 1)[..., None], 3, axis=2).astype(np.uint8)


def render(rig: Rig, scene: Scene, pose: Array | None = None) -> tuple[NDArray, NDArray]:
    return FrameRays(rig).render(Renderer(scene), np.eye(4) if pose is None else pose)


def refined(image: NDArray[np.uint8], corners: Array) -> Array:
    """Corners found near the expected ones, by OpenCV."""
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-4)
    start = corners.astype(np.float32).reshape(-1, 1, 2)
    return cv2.cornerSubPix(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), start, (4, 4), (-1, -1), criteria)[:, 0]


@pytest.fixture(scope="module")
def folded_rays() -> tuple[Rig, FrameRays]:
    """The paper's rig behind a lens with distortion."""
    rig = presets.ryu()
    rig = replace(rig, camera=replace(rig.camera, distortion=(-0.05, 0.01, 4e-4, -3e-4, 0.0)))
    return rig, FrameRays(rig)


@pytest.mark.parametrize("yaw", [0.0, np.pi / 2, np.pi, -np.pi / 2])
def test_board_corners_in_the_mirrors_are_where_the_rig_projects_them(
    folded_rays: tuple[Rig, FrameRays], yaw: float
) -> None:
    rig, rays = folded_rays
    board = placed([wall(chessboard(9, 100), 1.0, 1.0, y=1.5)], 0.0, 0.0, yaw, 0.1)[0]
    pose = se3.exp([0.02, -0.03, 0.05, 0.04, -0.06, 0.02])
    radiance, _ = rays.render(Renderer(Scene((board,), (LIGHT,))), pose)
    image = Sensor().develop(radiance, 0.5 / float(radiance.max()))
    u, v = np.meshgrid(np.arange(1, 9) / 9, np.arange(1, 9) / 9)
    inside = se3.transform(se3.inverse(pose), board.at(np.column_stack([u.ravel(), v.ravel()])))
    found = 0
    for name in rig.view_names:
        pixels, visible = rig.project(name, inside)
        clear = visible & (rig.mask(12)[tuple(np.rint(pixels[:, ::-1]).astype(int).T)] > 0)
        if clear.any():
            found += int(clear.sum())
            error = refined(image, pixels[clear]) - pixels[clear]
            assert np.abs(error).max() < 0.12
            assert np.sqrt(np.mean(error**2)) < 0.06
    assert found >= 12


def test_distances_in_a_box_room_are_those_of_its_planes() -> None:
    low, high = np.array([-2.0, -1.5, -1.0]), np.array([2.5, 3.0, 1.2])
    rig = pinhole((-0.2, 0.05, 1e-3, -1e-3, 0.0))
    pose = se3.exp([0.3, -0.2, 0.9, 0.2, 0.1, -0.1])
    _, depth = render(rig, closed_room(low, high), pose)
    rows, columns = np.mgrid[0:240:7, 0:320:7]
    _, directions = rig.ray("direct", np.column_stack([columns.ravel(), rows.ravel()]))
    world = directions @ pose[:3, :3].T
    planes = np.where(world > 0, high, low)
    expected = ((planes - pose[:3, 3]) / world).min(axis=1)
    assert np.allclose(depth[rows.ravel(), columns.ravel()], expected, rtol=1e-5)


def test_every_pixel_of_a_view_has_a_distance_and_no_other(folded_rays: tuple[Rig, FrameRays]) -> None:
    rig, rays = folded_rays
    scene = closed_room(np.array([-2.0, -2.0, -1.0]), np.array([2.0, 2.0, 1.0]))
    radiance, depth = rays.render(Renderer(scene), np.eye(4))
    assert np.array_equal(np.isfinite(depth), rig.labels() >= 0)
    assert not radiance[cv2.dilate((rig.labels() >= 0).astype(np.uint8), np.ones((3, 3))) == 0].any()


def test_tree_finds_the_same_surface_as_trying_them_all() -> None:
    rng = np.random.default_rng(3)
    surfaces = []
    for _ in range(40):
        size = rng.uniform(0.1, 0.8, 3)
        made = box(rng, -size / 2, size / 2, plain((128, 128, 128)), without=())
        surfaces += placed(made, *rng.uniform(-2, 2, 2), rng.uniform(-3, 3), rng.uniform(-1, 1))
    renderer = Renderer(Scene(tuple(surfaces), (LIGHT,)))
    origins = rng.uniform(-2, 2, (3000, 3))
    directions = rng.standard_normal((3000, 3))
    directions[::10, 0] = 0.0  # along a coordinate plane
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    hits = renderer.trace(origins, directions)
    nearest = np.array([tried(s, origins, directions) for s in surfaces])
    distance = nearest.min(axis=0)
    assert np.array_equal(np.isfinite(hits["distance"]), np.isfinite(distance))
    met = np.isfinite(distance)
    assert 0.2 < met.mean() < 0.95
    assert np.allclose(hits["distance"][met], distance[met], rtol=1e-4, atol=1e-5)
    assert np.all(hits["surface"][~met] == -1)
    assert np.allclose(
        nearest[hits["surface"][met], np.flatnonzero(met)], distance[met], rtol=1e-4, atol=1e-5
    )


def tried(surface: Surface, origins: Array, directions: Array) -> Array:
    """Distance along rays to one surface, inf where they miss it or see its back."""
    t = (surface.corner - origins) @ surface.normal / (directions @ surface.normal)
    place = origins + t[:, None] * directions - surface.corner
    u, v = (place @ edge / (edge @ edge) for edge in (surface.right, surface.down))
    hit = (directions @ surface.normal < 0) & (t > 1e-5) & (abs(u - 0.5) <= 0.5) & (abs(v - 0.5) <= 0.5)
    return np.where(hit, t, np.inf)


def test_light_follows_lamberts_law() -> None:
    white = wall(np.full((64, 64, 3), 255, np.uint8))
    lamp = Lamp((0.3, 1.0, 0.2), 2.0, (1.0, 0.5, 0.25))
    renderer = Renderer(Scene((white,), (lamp,)))
    place = np.array([[0.5, 2.0, -0.4], [-0.6, 2.0, 0.1], [0.3, 2.0, 0.2]])
    directions = place / np.linalg.norm(place, axis=1, keepdims=True)
    hits = renderer.trace(np.zeros(3), directions)
    radiance = renderer.shade(hits, directions.astype(np.float32), 1e-3, renderer.lighting())
    towards = np.array(lamp.position) - place
    direct = 2.0 * -towards[:, 1] / np.linalg.norm(towards, axis=1) ** 3
    expected = (direct + SCATTERED * 2.0)[:, None] * [1.0, 0.5, 0.25]
    assert np.allclose(radiance, expected, rtol=0.03)  # the lamp is a ball, the map has texels


def test_a_block_throws_a_shadow_and_a_window_shines_forwards_only() -> None:
    grey = plain((255, 255, 255))
    screen = box(np.random.default_rng(0), (-0.4, 1.5, -0.4), (0.4, 1.55, 0.4), grey, without=())
    behind = Lamp((0.0, 0.5, 0.0), 1.0, facing=(0.0, -1.0, 0.0))
    places = np.array([[0.0, 2.0, 0.0], [0.95, 2.0, 0.0]])

    def direct(*lamps: Lamp) -> Array:
        renderer = Renderer(Scene((wall(np.full((8, 8, 3), 255, np.uint8)), *screen), lamps))
        start = places - [0.0, 0.2, 0.0]
        directions = np.tile(np.float32([0.0, 1.0, 0.0]), (2, 1))
        return renderer.shade(renderer.trace(start, directions), directions, 1e-3, renderer.lighting())[:, 0]

    shadow, lit = direct(Lamp((0.0, 0.5, 0.0), 1.0))
    assert shadow < SCATTERED
    assert lit > 0.19 + 0.8 * SCATTERED
    assert np.all(direct(behind) <= SCATTERED)


def test_lamps_keep_their_schedule() -> None:
    lamp = LIGHT.switched_off(2.0, fade=0.5)
    assert [lamp.level(t) for t in (0.0, 2.0, 2.25, 2.5, 9.0)] == [1.0, 1.0, 0.5, 0.0, 0.0]
    renderer = Renderer(Scene((wall(chessboard(2, 4)),), (lamp,)))
    assert renderer.lighting(0.0).min() > 0.0
    assert renderer.lighting(3.0).max() == 0.0


def test_squares_finer_than_a_pixel_melt_into_their_mean_light() -> None:
    board = chessboard(512, 2)  # 4 mm squares, seen at 9 mm a pixel
    radiance, _ = render(pinhole(), Scene((wall(board),), (Lamp((0.0, -20.0, 0.0), 400.0),)))
    middle = radiance[90:150, 130:190, 0]
    flat, _ = render(
        pinhole(), Scene((wall(np.full((4, 4, 3), 255, np.uint8)),), (Lamp((0.0, -20.0, 0.0), 400.0),))
    )
    mean = np.square(board.astype(float) / 255).mean()
    assert np.allclose(middle, mean * flat[90:150, 130:190, 0], rtol=0.02)


def test_rendering_does_not_depend_on_the_number_of_threads() -> None:
    scene = Scene((wall(chessboard(9, 16)),), (LIGHT,))
    rays = FrameRays(pinhole())
    one, two = (rays.render(Renderer(scene, threads=n), np.eye(4)) for n in (1, 3))
    assert all(np.array_equal(a, b) for a, b in zip(one, two))


def test_noise_has_the_variance_of_electrons() -> None:
    sensor = Sensor(full_well=1000.0, read_noise=5.0)
    light = np.full((300, 300, 3), 0.4, np.float32)
    image = sensor.develop(light, 1.0, np.random.default_rng(1)).astype(float)
    variance = np.square(image / 255.0).var()
    assert variance == pytest.approx(0.4 / 1000 + 0.005**2, rel=0.03)
    assert np.array_equal(sensor.develop(light, 1.0), np.full((300, 300, 3), round(255 * 0.4**0.5)))


def test_exposure_follows_a_change_of_light_late() -> None:
    exposure = AutoExposure(lag=1.0)
    bright = np.full((4, 4, 3), 0.8, np.float32)
    first = exposure.follow(bright, 0.0)
    assert exposure.follow(bright, 1.0) == pytest.approx(first)
    later = exposure.follow(bright / 4, 2.0)
    assert later / first == pytest.approx(4 ** (1 - np.exp(-1.0)))
    assert np.isfinite(AutoExposure().follow(np.zeros((4, 4, 3), np.float32), 0.0))


def test_native_kernels_refuse_tables_that_do_not_belong_together() -> None:
    rectangles = np.float32([[0, 1, 0, 1, 0, 0, 0, 0, -1, 1, 1]])
    directions = np.float32([[0, 1, 0]])
    tree = _core.RectangleTree(rectangles)
    with pytest.raises(ValueError, match="origins"):
        tree.cast(np.zeros((2, 3), np.float32), np.zeros((3, 3), np.float32), 1)
    texels, light = np.zeros((4, 3), np.uint8), np.zeros((1, 3), np.float32)
    fine, one = np.int32([[0, 2, 2, 1]]), np.int32([[0, 1, 1, 1]])
    hits = np.zeros(1, HIT)

    def shade(textures: NDArray, maps: NDArray, hits: NDArray) -> NDArray:
        rows = hits.view(np.uint8).reshape(-1, HIT.itemsize)
        return _core.shade_rays(rectangles, texels, textures, light, maps, directions, rows, 1e-3, 1)

    assert shade(fine, one, hits).shape == (1, 3)
    with pytest.raises(ValueError, match="textures"):
        shade(np.int32([[1, 2, 2, 1]]), one, hits)
    with pytest.raises(ValueError, match="light_maps"):
        shade(fine, np.int32([[0, 2, 1, 1]]), hits)
    with pytest.raises(ValueError, match="surface"):
        shade(fine, one, np.array([(7, 1.0, 0.5, 0.5)], HIT))
