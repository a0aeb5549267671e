"""Patch alignment on images whose warp, gain and bias are known."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from facetcam import _core
from facetcam.slam.camera.patches import PATCH_SIZE, cut_patches

Array = NDArray[np.float64]
Image = NDArray[np.uint8]
Light = Callable[[Array], Array]

SHIFT = np.array([[1.6, -0.9], [-2.1, 1.4], [0.0, 0.0], [2.4, 2.2]])  # px between prediction and truth
FEATURES = np.array([[60.3, 70.6], [110.0, 95.4], [141.7, 60.2], [95.5, 140.9]])  # of the reference image


def brightness(xy: Array) -> Array:
    """A smooth picture of about 60 to 190 grey levels, known everywhere."""
    x, y = xy[..., 0], xy[..., 1]
    waves = np.sin(0.48 * x + 0.11 * y) + np.sin(0.14 * x - 0.55 * y) + np.sin(0.36 * (x + y) + 1.0)
    return 125.0 + 22.0 * waves


def photograph(A: Array, b: Array, light: Light = lambda grey: grey) -> Image:
    """Picture of 200x200 pixels whose pixel p shows the reference's place A p + b."""
    pixels = np.stack(np.meshgrid(np.arange(200.0), np.arange(200.0)), axis=-1)
    return np.clip(np.rint(light(brightness(pixels @ A.T + b))), 0, 255).astype(np.uint8)


def align(
    reference: Image, image: Image, features: Array, A: Array, start: Array, threads: int = 2, isa: int = -1
) -> Array:
    """Rows x, y, score, spread of features (N, 2) of the reference, sought from `start` (N, 2)."""
    patches, offsets, kept = cut_patches(reference, features)
    assert kept.all()
    half = cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    warps = np.broadcast_to(A, (len(features), 2, 2)).astype(np.float32).copy()
    return _core.align_patches(
        image, half, patches.copy(), offsets, warps, start.astype(np.float32), 8.0, 12, threads, isa
    ).astype(float)


def turned(degrees: float, zoom: float = 1.0) -> Array:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return zoom * np.array([[c, -s], [s, c]])


WARPS = {
    "still": np.eye(2),
    "turned": turned(25.0),
    "upside down": turned(180.0),
    "nearer": turned(-10.0, 0.7),
    "farther": turned(5.0, 1.35),
    "slanted": np.array([[0.8, 0.25], [-0.1, 1.15]]),
    "mirrored": turned(20.0) @ np.diag([-1.0, 1.0]),
}


@pytest.mark.parametrize("A", WARPS.values(), ids=WARPS.keys())
@pytest.mark.parametrize("light", [lambda g: g, lambda g: 0.6 * g + 20.0], ids=["same light", "dimmed"])
def test_features_are_found_to_a_tenth_of_a_pixel(A: Array, light: Light) -> None:
    reference = photograph(np.eye(2), np.zeros(2))
    b = np.array([100.0, 100.0]) - A @ [98.7, 101.2]
    image = photograph(A, b, light)
    truth = (FEATURES - b) @ np.linalg.inv(A).T
    found = align(reference, image, FEATURES, A, truth + SHIFT)
    assert np.all(found[:, 2] > 0.98)
    assert np.linalg.norm(found[:, :2] - truth, axis=1).max() < 0.1


@pytest.mark.parametrize("A", WARPS.values(), ids=WARPS.keys())
@pytest.mark.parametrize("isa", range(_core.best_isa() + 1))
def test_every_instruction_set_and_number_of_threads_gives_the_same_bits(A: Array, isa: int) -> None:
    rng = np.random.default_rng(5)
    reference, b = photograph(np.eye(2), np.zeros(2)), np.array([100.0, 100.0]) - A @ [98.7, 101.2]
    image = photograph(A, b)
    image[::7] += rng.integers(0, 30, image[::7].shape, dtype=np.uint8)
    features = rng.uniform(40.0, 160.0, (300, 2))
    start = (features - b) @ np.linalg.inv(A).T + rng.normal(0.0, 2.0, features.shape)
    best, other = (align(reference, image, features, A, start, *how) for how in ((2, -1), (1, isa)))
    assert np.sum(best[:, 2] > 0.8) > 100
    np.testing.assert_array_equal(other, best)


def test_a_mirror_image_is_not_found_with_a_proper_warp() -> None:
    reference = photograph(np.eye(2), np.zeros(2))
    mirror = np.diag([-1.0, 1.0])
    image = photograph(mirror, np.array([199.0, 0.0]))
    truth = FEATURES * [-1.0, 1.0] + [199.0, 0.0]
    assert np.all(align(reference, image, FEATURES, mirror, truth)[:, 2] > 0.99)
    assert np.all(align(reference, image, FEATURES, np.eye(2), truth)[:, 2] < 0.8)


def test_flat_patches_and_flat_frames_fail() -> None:
    picture, flat = photograph(np.eye(2), np.zeros(2)), np.full((200, 200), 90, np.uint8)
    assert np.all(align(flat, picture, FEATURES, np.eye(2), FEATURES)[:, 2] == -1)
    assert np.all(align(picture, flat, FEATURES, np.eye(2), FEATURES)[:, 2] == -1)


def test_features_on_the_border_and_beyond_fail() -> None:
    picture = photograph(np.eye(2), np.zeros(2))
    start = np.array([[3.0, 100.0], [100.0, 198.0], [-50.0, 20.0], [1e6, 1e6]])
    assert np.all(align(picture, picture, FEATURES, np.eye(2), start)[:, 2] == -1)


def test_a_search_that_runs_too_far_fails() -> None:
    picture = photograph(np.eye(2), np.zeros(2))
    start = FEATURES + np.array([7.5, 7.5])
    found = align(picture, picture, FEATURES, np.eye(2), start)
    moved = np.linalg.norm(found[:, :2] - start, axis=1)
    assert np.all(moved[found[:, 2] > -1] <= 8.01)
    assert np.all(np.linalg.norm(found[:, :2] - FEATURES, axis=1) > 1.0)


def test_spread_is_the_error_that_noise_makes() -> None:
    """Over many noisy pictures, positions scatter as told, and an edge scatters along itself."""
    rng = np.random.default_rng(3)
    reference = photograph(np.eye(2), np.zeros(2))
    sigma, count = 3.0, 300
    errors = []
    for _ in range(count):
        noisy = np.clip(reference + rng.normal(0.0, sigma, reference.shape), 0, 255).astype(np.uint8)
        found = align(reference, noisy, FEATURES, np.eye(2), FEATURES)
        errors.append(found[:, :2] - FEATURES)
    scatter = np.array([np.cov(np.array(errors)[:, i].T) for i in range(len(FEATURES))])
    weaker = np.sqrt(np.linalg.eigvalsh(scatter)[:, 1])
    told = sigma * found[:, 3]
    assert np.all(weaker < 1.5 * told)
    assert np.all(weaker > 0.4 * told)  # interpolation between pixels smooths the noise


def test_patches_are_cut_round_the_nearest_pixel() -> None:
    picture = photograph(np.eye(2), np.zeros(2))
    half = PATCH_SIZE // 2
    xy = np.array([[60.3, 70.6], [half + 0.2, half], [half - 0.6, 90.0], [90.0, 199 - half + 0.7]])
    patches, offsets, kept = cut_patches(picture, xy)
    assert kept.tolist() == [True, True, False, False]
    assert np.array_equal(patches[0], picture[71 - half : 72 + half, 60 - half : 61 + half])
    np.testing.assert_allclose(offsets[0], [0.3, -0.4], atol=1e-5)
