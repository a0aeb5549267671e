"""Scenes of rectangles against closed formulas: projections, shadows, filtering; the sensor's noise."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from simulated_rooms import resized

from facetcam.geometry import se3
from facetcam.rig import Rig, View, presets
from facetcam.rig.camera import BROWN_CONRADY, Camera
from facetcam.simulation.exposures import Exposures
from facetcam.simulation.film import renderer_of
from facetcam.simulation.light import SCATTERED
from facetcam.simulation.materials import plain
from facetcam.simulation.scene import Lamp, Scene, Surface, box, placed
from facetcam.simulation.sensor import AutoExposure, Sensor
from facetcam.simulation.settings import CameraSettings

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


def chessboard(squares: int, texels: int) -> NDArray[np.uint8]:
    fields = np.indices((squares, squares)).sum(axis=0) % 2 * 200 + 40
    return np.repeat(fields.repeat(texels, 0).repeat(texels, 1)[..., None], 3, axis=2).astype(np.uint8)


def refined(image: NDArray[np.uint8], corners: Array) -> Array:
    """Corners found near the expected ones, by OpenCV."""
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-4)
    start = corners.astype(np.float32).reshape(-1, 1, 2)
    return cv2.cornerSubPix(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), start, (4, 4), (-1, -1), criteria)[:, 0]


def radiance(rig: Rig, scene: Scene, pose: Array, samples: int) -> NDArray[np.float32]:
    settings = CameraSettings(samples=samples)
    return Exposures(rig, renderer_of(scene), settings).radiance(lambda time: pose, 0.0)


def test_board_corners_in_the_mirrors_are_where_the_rig_projects_them() -> None:
    rig = resized(presets.ryu(), 0.5)
    rig = replace(rig, camera=replace(rig.camera, distortion=(-0.05, 0.01, 4e-4, -3e-4, 0.0)))
    upright = wall(chessboard(9, 100), 1.0, 1.0, y=1.5)
    boards = [placed([upright], 0.0, 0.0, k * np.pi / 2, 0.1)[0] for k in range(4)]
    pose = se3.exp([0.02, -0.03, 0.05, 0.04, -0.06, 0.02])
    light = radiance(rig, Scene(tuple(boards), (LIGHT,)), pose, samples=8)
    image = Sensor().develop(light, 0.5 / float(light.max()))
    u, v = np.meshgrid(np.arange(1, 9) / 9, np.arange(1, 9) / 9)
    corners = np.vstack([board.at(np.column_stack([u.ravel(), v.ravel()])) for board in boards])
    inside = se3.transform(se3.inverse(pose), corners)
    for name in rig.view_names:
        pixels, visible = rig.project(name, inside)
        clear = visible & (rig.mask(12)[tuple(np.rint(pixels[:, ::-1]).astype(int).T)] > 0)
        assert clear.sum() >= 12
        error = refined(image, pixels[clear]) - pixels[clear]
        assert np.abs(error).max() < 0.12
        assert np.sqrt(np.mean(error**2)) < 0.06


def test_a_block_throws_a_shadow_and_a_window_shines_forwards_only() -> None:
    grey = plain((255, 255, 255))
    screen = box(np.random.default_rng(0), (-0.4, 1.5, -0.4), (0.4, 1.55, 0.4), grey, without=())
    behind = Lamp((0.0, 0.5, 0.0), 1.0, facing=(0.0, -1.0, 0.0))
    places = np.array([[0.0, 2.0, 0.0], [0.95, 2.0, 0.0]])

    def direct(*lamps: Lamp) -> Array:
        renderer = renderer_of(Scene((wall(np.full((8, 8, 3), 255, np.uint8)), *screen), lamps))
        start = np.float32(places - [0.0, 0.2, 0.0])
        ahead, none = np.tile(np.float32([0.0, 1.0, 0.0]), (2, 1)), np.zeros(2, np.float32)
        return renderer.look(start, ahead, none, 1e-3, renderer.lighting())[0][:, 0]

    shadow, lit = direct(Lamp((0.0, 0.5, 0.0), 1.0))
    assert shadow < SCATTERED
    assert lit > 0.19 + 0.8 * SCATTERED
    assert np.all(direct(behind) <= SCATTERED)


def test_lamps_keep_their_schedule() -> None:
    lamp = LIGHT.switched_off(2.0, fade=0.5)
    assert [lamp.level(t) for t in (0.0, 2.0, 2.25, 2.5, 9.0)] == [1.0, 1.0, 0.5, 0.0, 0.0]
    renderer = renderer_of(Scene((wall(chessboard(2, 4)),), (lamp,)))
    assert renderer.lighting(0.0).min() > 0.0
    assert renderer.lighting(3.0).max() == 0.0


def test_squares_finer_than_a_pixel_melt_into_their_mean_light() -> None:
    board = chessboard(512, 2)  # 4 mm squares, seen at 9 mm a pixel
    fine, flat = (
        radiance(pinhole(), Scene((wall(picture),), (Lamp((0.0, -20.0, 0.0), 400.0),)), np.eye(4), samples=1)
        for picture in (board, np.full((4, 4, 3), 255, np.uint8))
    )
    mean = np.square(board.astype(float) / 255).mean()
    assert np.allclose(fine[90:150, 130:190], mean * flat[90:150, 130:190], rtol=0.02)


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
