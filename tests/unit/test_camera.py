"""Camera models against OpenCV, and where a lens gives nothing."""

from __future__ import annotations

import pickle

import cv2
import numpy as np
import pytest

from facetcam.errors import RigError
from facetcam.rig import Camera

BROWN = Camera(
    "brown-conrady", 1600, 1200, 1243.6, 1244.9, 803.8, 596.4, (-0.09, 0.035, 0.0004, -0.0003, 0.01)
)
FISHEYE = Camera("kannala-brandt", 1600, 1200, 420.0, 422.0, 803.8, 596.4, (0.02, -0.004, 0.0007, -0.0001))
CAMERAS = [pytest.param(BROWN, id="brown-conrady"), pytest.param(FISHEYE, id="kannala-brandt")]


def points_in_front(count: int = 500) -> np.ndarray:
    rng = np.random.default_rng(1)
    return np.column_stack([rng.uniform(-1, 1, (count, 2)), rng.uniform(0.9, 3.0, count)])


def opencv_pixels(camera: Camera, points: np.ndarray) -> np.ndarray:
    project = cv2.projectPoints if camera.model == "brown-conrady" else cv2.fisheye.projectPoints
    zero = np.zeros((3, 1))
    pixels = project(points[:, None], zero, zero, camera.K, np.array(camera.distortion))[0]
    return pixels.reshape(-1, 2)


@pytest.mark.parametrize("camera", CAMERAS)
def test_project_agrees_with_opencv(camera: Camera) -> None:
    points = points_in_front()
    pixels, valid = camera.project(points)
    expected = opencv_pixels(camera, points)
    on_sensor = np.all((expected >= -0.5) & (expected < (camera.width - 0.5, camera.height - 0.5)), axis=1)
    np.testing.assert_array_equal(valid, on_sensor)
    assert valid.sum() > 200
    np.testing.assert_allclose(pixels[valid], expected[valid], atol=1e-9)
    assert np.all(pixels[~valid] == 0)


@pytest.mark.parametrize("camera", CAMERAS)
def test_ray_undoes_project_over_the_whole_sensor(camera: Camera) -> None:
    v, u = np.mgrid[0:1200:25, 0:1600:25]
    pixels = np.column_stack([u.ravel(), v.ravel()]).astype(float)
    rays = camera.ray(pixels)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1.0, atol=1e-12)
    back, valid = camera.project(2.5 * rays)
    assert valid.all()
    np.testing.assert_allclose(back, pixels, atol=1e-9)


def test_a_wide_lens_sees_behind_its_plane() -> None:
    rays = FISHEYE.ray([[803.8, 1190.0], [20.0, 596.4]])
    assert rays[0, 2] > 0 > rays[1, 2]
    back, valid = FISHEYE.project(0.7 * rays)
    assert valid.all()
    np.testing.assert_allclose(back, [[803.8, 1190.0], [20.0, 596.4]], atol=1e-9)


def test_the_point_straight_behind_has_no_pixel() -> None:
    camera = Camera("kannala-brandt", 1600, 1200, 100.0, 100.0, 800.0, 600.0, (0.0,) * 4)
    _, valid = camera.project([[0, 0, -1.0], [0, 0, 0], [0, 0, 1.0], [1e-3, 0, -1.0]])
    assert valid.tolist() == [False, False, True, True]


@pytest.mark.parametrize("camera", CAMERAS)
def test_nothing_invalid_is_called_valid(camera: Camera) -> None:
    points = [[0.0, 0.0, -1.0], [np.nan, 0.0, 1.0], [np.inf, 0.0, 1.0], [0.0, 0.0, 0.0]]
    pixels, valid = camera.project(points)
    assert not valid.any()
    assert np.all(pixels == 0)


def test_beyond_the_turning_point_of_the_distortion_there_is_no_ray() -> None:
    camera = Camera("brown-conrady", 640, 480, 300.0, 300.0, 319.5, 239.5, (-0.4, 0.0, 0.0, 0.0, 0.0))
    turning = np.sqrt(1 / (3 * 0.4))
    farthest = 300.0 * turning * (1 - 0.4 * turning**2)
    rays = camera.ray([[319.5 + farthest - 1, 239.5], [319.5 + farthest + 1, 239.5]])
    assert np.linalg.norm(rays[0]) == pytest.approx(1.0)
    np.testing.assert_array_equal(rays[1], 0.0)
    # A point outside folds back onto the sensor by the formula; it must not be taken for one inside.
    _, valid = camera.project([[1.3, 0.0, 1.0]])
    assert not valid[0]


def test_mirrored_camera_sees_the_flipped_image() -> None:
    points = points_in_front()
    pixels, valid = BROWN.project(points)
    flipped, _ = BROWN.mirrored().project(points * (-1, 1, 1))
    np.testing.assert_allclose(flipped[valid, 0], 1599 - pixels[valid, 0], atol=1e-9)
    np.testing.assert_allclose(flipped[valid, 1], pixels[valid, 1], atol=1e-9)


def test_a_used_camera_can_be_pickled() -> None:
    BROWN.ray([[10.0, 10.0]])
    assert pickle.loads(pickle.dumps(BROWN)) == BROWN


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"model": "pinhole"}, "unknown model 'pinhole'"),
        ({"distortion": (0.0,) * 4}, "takes 5 distortion numbers, got 4"),
        ({"width": 1}, "the size 1x1200"),
        ({"height": 10**9}, "the size 1600x1000000000"),
        ({"fx": float("nan")}, "must be finite"),
        ({"fy": -1.0}, "must be positive"),
    ],
)
def test_impossible_cameras_are_refused(change: dict[str, object], message: str) -> None:
    values = {name: getattr(BROWN, name) for name in BROWN.__dataclass_fields__}
    with pytest.raises(RigError, match=message):
        Camera(**(values | change))
