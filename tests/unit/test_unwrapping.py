"""Unwrapped pictures: each pixel shows the direction it should, and nothing else."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from facetcam.errors import ConfigError, OutputError, SourceError
from facetcam.rig import Camera, Rig, View, presets
from facetcam.unwrapping import Panorama, unwrap, write_views
from facetcam.unwrapping.resampler import Resampler

Image = NDArray[np.float32]


def small(rig: Rig) -> Rig:
    """Half the pixels, and a lens with distortion."""
    focal = rig.camera.fx / 2
    distortion = (-0.09, 0.035, 4e-4, -3e-4, 0.0)
    return replace(rig, camera=Camera("brown-conrady", 800, 600, focal, focal, 401.0, 297.0, distortion))


def fisheye() -> Rig:
    """A wide lens that looks to the front and up, with more than 180 degrees."""
    camera = Camera("kannala-brandt", 800, 600, 200.0, 200.0, 399.5, 299.5, (0.01, 0.0, 0.0, 0.0))
    c, s = math.cos(0.3), math.sin(0.3)
    T_rig_cam = np.array([[1, 0, 0, 0], [0, s, c, 0], [0, -c, s, 0.3], [0, 0, 0, 1.0]])
    return Rig(camera, T_rig_cam, {}, {"direct": View()})


RIGS = {
    "folded": small(presets.ryu()),
    "pyramid": small(presets.pyramid(5)),
    "table": small(presets.table()),
    "fisheye": fisheye(),
}


def frame_of_directions(rig: Rig) -> Image:
    """A raw frame whose three channels are the direction that each pixel sees; zero where none."""
    frame = np.zeros((rig.camera.height, rig.camera.width, 3), dtype=np.float32)
    labels = rig.labels()
    for index, name in enumerate(rig.views):
        v, u = np.nonzero(labels == index)
        frame[v, u] = rig.ray(name, np.column_stack([u, v]))[1]
    return frame


@pytest.fixture(scope="module", params=RIGS)
def rig(request: pytest.FixtureRequest) -> Rig:
    return RIGS[request.param]


def test_every_pixel_shows_its_own_direction(rig: Rig) -> None:
    unwrapper = unwrap(rig)
    pictures = unwrapper(frame_of_directions(rig))
    assert list(pictures) == list(rig.views)
    for name, picture in pictures.items():
        view, seen = unwrapper.views[name], unwrapper.mask(name) > 0
        v, u = np.indices(seen.shape)
        camera = view.camera
        rays = np.stack(
            [(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(seen.shape)], axis=-1
        )
        rays = (rays / np.linalg.norm(rays, axis=-1, keepdims=True)) @ view.T_rig_view[:3, :3].T
        assert seen.mean() > 0.2
        # Between pixels, directions bend by up to 1 / (8 f^2) along each axis.
        np.testing.assert_allclose(picture[seen], rays[seen], atol=1e-6 + 1 / (4 * rig.camera.fx**2))
        assert not picture[~seen].any()


def test_views_are_proper_upright_and_at_their_centres(rig: Rig) -> None:
    for name, view in unwrap(rig).views.items():
        R = view.T_rig_view[:3, :3]
        assert np.linalg.det(R) == pytest.approx(1.0)
        np.testing.assert_allclose(view.T_rig_view[:3, 3], rig.T_rig_view(name)[:3, 3], atol=1e-12)
        assert abs(R[2, 0]) < 1e-9  # the rows of the picture are level
        assert R[2, 1] < 0  # and its top is up
        assert view.flipped == (len(rig.views[name].mirrors) % 2 == 1)


def test_default_pictures_fit_what_the_view_sees() -> None:
    unwrapper = unwrap(RIGS["folded"])
    for name in unwrapper.views:
        rows, columns = np.nonzero(unwrapper.mask(name))
        height, width = unwrapper.mask(name).shape
        assert max(rows.min(), columns.min(), height - 1 - rows.max(), width - 1 - columns.max()) <= 6


def test_a_very_wide_view_is_cut_at_120_degrees() -> None:
    camera = unwrap(RIGS["fisheye"]).views["direct"].camera
    assert math.degrees(2 * math.atan(camera.width / 2 / camera.fx)) == pytest.approx(120, abs=2)


def test_a_camera_that_looks_straight_down_keeps_its_own_up() -> None:
    down = np.diag([1.0, -1.0, -1.0, 1.0])
    rig = Rig(replace(RIGS["folded"].camera), down, {}, {"direct": View()})
    R = unwrap(rig).views["direct"].T_rig_view[:3, :3]
    np.testing.assert_allclose(R, down[:3, :3], atol=0.05)


def test_a_ring_on_a_wide_lens_gives_a_picture_of_its_rim() -> None:
    turn = np.linspace(0, math.tau, 40)
    circle = np.column_stack([np.cos(turn), np.sin(turn)])
    ring = np.vstack([290 * circle, 270 * circle[::-1]]) + np.array([399.5, 299.5])
    whole = RIGS["fisheye"]
    unwrapper = unwrap(Rig(whole.camera, whole.T_rig_cam, {}, {"rim": View((), ring)}))
    assert np.count_nonzero(unwrapper.mask("rim")) > 1000


def test_size_and_field_of_view_are_as_asked() -> None:
    unwrapper = unwrap(RIGS["folded"], size=(320, 200), fov=math.radians(20), views=["left"])
    assert list(unwrapper.views) == ["left"]
    camera = unwrapper.views["left"].camera
    assert (camera.width, camera.height) == (320, 200)
    assert math.degrees(2 * math.atan(160 / camera.fx)) == pytest.approx(20)
    assert unwrapper(np.zeros((600, 800), np.uint8))["left"].shape == (200, 320)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("channels", [(), (1,), (3,)])
def test_resampling_is_bilinear(dtype: type, channels: tuple[int, ...]) -> None:
    rng = np.random.default_rng(0)
    top = 1.0 if dtype is np.float32 else np.iinfo(dtype).max
    image = (rng.random((40, 50, *channels)) * top).astype(dtype)
    pixels = rng.uniform(0, (49, 39), (2, 30, 60, 2))
    pixels[0, 0, :4] = [[0, 0], [49, 39], [49, 0], [0, 39]]
    valid = rng.random((2, 30, 60)) < 0.7
    valid[0, 0, :4] = True
    valid[1, 5] = False
    pictures = Resampler(list(pixels), list(valid), (50, 40))(image)
    layers = image.reshape(40, 50, -1).astype(np.float64)
    for picture, place, shown in zip(pictures, pixels, valid):
        assert picture.dtype == dtype and picture.shape == (30, 60, *channels)
        values = [
            map_coordinates(layer, place[..., ::-1].T, order=1).T for layer in np.moveaxis(layers, 2, 0)
        ]
        expected = np.where(shown[..., None], np.stack(values, axis=-1), 0.0)
        # Positions are kept to 1/2048 px, and integers are rounded.
        tolerance = top / 2048 + (0 if dtype is np.float32 else 0.5)
        np.testing.assert_allclose(picture.reshape(expected.shape), expected, atol=tolerance)


def test_a_colour_picture_is_its_three_grey_ones() -> None:
    frame = np.random.default_rng(3).integers(0, 256, (600, 800, 3), dtype=np.uint8)
    unwrapper = unwrap(RIGS["table"])
    colour = unwrapper(frame)
    for channel in range(3):
        grey = unwrapper(np.ascontiguousarray(frame[:, :, channel]))
        for name, picture in grey.items():
            np.testing.assert_array_equal(colour[name][:, :, channel], picture)


def test_the_result_does_not_depend_on_threads() -> None:
    unwrapper = unwrap(RIGS["folded"], size=(640, 480))
    frame = np.random.default_rng(1).integers(0, 256, (600, 800, 3), dtype=np.uint8)
    before = cv2.getNumThreads()
    try:
        cv2.setNumThreads(1)
        one = unwrapper(frame)
        cv2.setNumThreads(4)
        many = unwrapper(frame)
    finally:
        cv2.setNumThreads(before)
    assert all(np.array_equal(one[name], many[name]) for name in one)


@pytest.mark.parametrize("projection", ["equirectangular", "cylindrical"])
def test_a_panorama_far_away_shows_every_direction_in_its_place(projection: str) -> None:
    rig = RIGS["folded"]
    panorama = Panorama(rig, depth=1e6, width=1024, projection=projection)
    picture, seen = panorama(frame_of_directions(rig)), panorama.mask > 0
    v, u = np.nonzero(seen)
    azimuth = (u - 511.5) / 1024 * math.tau  # clockwise from the front, as one turns
    x, y, z = picture[v, u].T
    np.testing.assert_allclose(np.arctan2(x, y), azimuth, atol=1e-5)
    height = z / np.hypot(x, y) if projection == "cylindrical" else np.arcsin(z)
    slope, _ = np.polyfit(v, height, 1)
    assert slope == pytest.approx(-math.tau / 1024, rel=1e-3)


def test_holes_of_a_panorama_are_hatched() -> None:
    panorama = Panorama(RIGS["folded"], depth=2.0, width=1024)
    for frame in (np.zeros((600, 800), np.uint8), np.zeros((600, 800, 3), np.uint16)):
        picture, holes = panorama(frame), panorama.mask == 0
        assert 0.3 < holes.mean() < 0.95
        assert len(np.unique(picture[holes])) == 2 and picture[holes].min() > 0
        assert not picture[~holes].any()


def test_a_point_at_the_stated_depth_is_where_it_should_be() -> None:
    rig, depth, width = RIGS["folded"], 0.4, 2048
    panorama = Panorama(rig, depth, width)
    for name in rig.views:
        v, u = np.nonzero(rig.labels() == rig.view_names.index(name))
        pixel = np.array([np.median(u), np.median(v)]).round()
        x, y = pixel.astype(int)
        frame = np.zeros((600, 800), np.uint8)
        frame[y - 1 : y + 2, x - 1 : x + 2] = 255
        centre, ray = (a[0] for a in rig.ray(name, [pixel]))
        offset = centre - panorama.centre
        along = -offset @ ray + math.sqrt((offset @ ray) ** 2 - offset @ offset + depth**2)
        east, north, _ = offset + along * ray
        shown = np.nonzero((panorama(frame) == 255) & (panorama.mask > 0))[1]
        expected = (math.atan2(east, north) / math.tau + 0.5) * width - 0.5
        turn = (shown - expected + width / 2) % width - width / 2
        assert abs(turn.mean()) < 0.7


def test_views_file_tells_the_cameras(tmp_path: Path) -> None:
    views = unwrap(RIGS["pyramid"], size=(640, 480)).views
    path = tmp_path / "views.yaml"
    write_views(views.values(), path)
    told = yaml.safe_load(path.read_text())
    assert list(told) == list(views)
    for name, entry in told.items():
        camera = Camera(
            "brown-conrady", *(entry[k] for k in ("width", "height", "fx", "fy", "cx", "cy")), (0.0,) * 5
        )
        assert camera == views[name].camera
        np.testing.assert_array_equal(entry["T_rig_view"], views[name].T_rig_view)
        assert entry["flipped"] is True
    with pytest.raises(OutputError, match=r"views\.yaml"):
        write_views(views.values(), path)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"views": ["frnt"]}, "did you mean 'front'"),
        ({"fov": 4.0}, "must lie between 0 and pi"),
        ({"fov": float("nan")}, "must lie between 0 and pi"),
        ({"size": (640, 0)}, "two pixels or more"),
    ],
)
def test_impossible_wishes_are_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        unwrap(RIGS["folded"], **options)


@pytest.mark.parametrize(
    "frame",
    [np.zeros((480, 640), np.uint8), np.zeros((600, 800, 4), np.uint8), np.zeros((600, 800), np.int32)],
)
def test_a_frame_that_does_not_fit_is_refused(frame: NDArray[np.generic]) -> None:
    with pytest.raises(SourceError, match="image: "):
        unwrap(RIGS["folded"], views=["front"])(frame)


def test_a_panorama_needs_a_depth_and_a_width() -> None:
    with pytest.raises(ConfigError, match="must be positive"):
        Panorama(RIGS["folded"], depth=0.0)
    with pytest.raises(ConfigError, match="must be 64 to 16384"):
        Panorama(RIGS["folded"], depth=1.0, width=10)
