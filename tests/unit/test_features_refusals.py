"""What detectors and descriptors say to parameters, images and keypoints that make no sense."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest

from facetcam.errors import ConfigError, FacetcamError
from facetcam.features import SIICF, DoG, HarrisLaplace, Keypoints, LoG, describe


@pytest.fixture(scope="module")
def scene() -> np.ndarray:
    rng = np.random.default_rng(3)
    return cv2.resize(rng.integers(0, 256, (40, 50), np.uint8), (200, 160), interpolation=cv2.INTER_CUBIC)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("max_features", 2.5, "expected int, got 2.5"),
        ("max_features", "3", "expected int, got '3'"),
        ("max_features", -1, "must be at least 1"),
        ("scales", 2.5, "expected int, got 2.5"),
        ("spread", 3.3, "expected int"),
        ("border", 2.5, "expected int"),
        ("threads", 1.5, "expected int"),
        ("levels", 1.5, "expected int"),
        ("sigma", None, "expected float, got None"),
        ("sigma", float("nan"), "must be finite"),
        ("oriented", "yes", "expected bool"),
        ("mode", 3, "expected str"),
        ("descriptor", None, "expected str"),
        ("etas", 5, "expected a list"),
    ],
)
def test_parameters_of_wrong_type_are_told_in_one_line(name: str, value: Any, message: str) -> None:
    with pytest.raises(ConfigError, match=f"SIICF: {name}.* ?{message}") as told:
        SIICF.create(**{name: value})
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("detector", [LoG, DoG, HarrisLaplace])
@pytest.mark.parametrize("count", [2.5, 0])
def test_baselines_check_the_same(detector: Any, count: Any) -> None:
    with pytest.raises(ConfigError, match=f"{detector.__name__}: max_features"):
        detector.create(max_features=count)


@pytest.mark.parametrize("detector", [SIICF, DoG, HarrisLaplace])
def test_more_than_there_can_be_are_all(detector: Any, scene: np.ndarray) -> None:
    found, expected = (detector.create(max_features=count).detect(scene) for count in (10**12, None))
    np.testing.assert_array_equal(found.xy, expected.xy)


def test_numbers_of_numpy_are_numbers(scene: np.ndarray) -> None:
    found = SIICF.create(max_features=np.int64(5), eta=np.float32(64), scales=np.uint8(3)).detect(scene)
    np.testing.assert_array_equal(found.xy, SIICF.create(max_features=5).detect(scene).xy)


@pytest.mark.parametrize("mode", ["robust", "paper"])
@pytest.mark.parametrize("dtype", ["u2", "f4", "f8"])
def test_the_order_of_bytes_changes_nothing(scene: np.ndarray, mode: str, dtype: str) -> None:
    detector = SIICF.create(mode=mode)
    wide = 257.0 * scene if dtype == "u2" else scene / 255.0
    little, big = (detector.detectAndCompute(wide.astype(order + dtype)) for order in "<>")
    assert len(little[0]) > 20
    np.testing.assert_array_equal(big[0].xy, little[0].xy)
    np.testing.assert_array_equal(big[1], little[1])


def test_numbers_beyond_single_precision(scene: np.ndarray) -> None:
    with pytest.raises(FacetcamError, match="NaN, infinite or beyond float32"):
        SIICF.create().detect(scene * 1e300)


def keypoint(x: float = 50.0, size: float = 10.0, angle: float = 0.0) -> Keypoints:
    return Keypoints.at(np.array([[x, 60.0]], np.float32), size, angle)


@pytest.mark.parametrize("descriptor", ["gradients", "binary"])
@pytest.mark.parametrize("flipped", [False, True])
def test_keypoints_that_are_none(scene: np.ndarray, descriptor: str, flipped: bool) -> None:
    nan, inf = float("nan"), float("inf")
    for wrong in (keypoint(nan), keypoint(-inf), keypoint(size=nan), keypoint(size=-3), keypoint(angle=inf)):
        with pytest.raises(FacetcamError, match="keypoints: 1 with a place, size or angle"):
            describe(scene, wrong, flipped, descriptor)
    # Far outside, larger than the picture, turned many times: described somehow, without a crash.
    for odd in (keypoint(-1e6), keypoint(1e6), keypoint(size=1e8), keypoint(size=0), keypoint(angle=1e8)):
        kept, descriptors = describe(scene, odd, flipped, descriptor)
        assert len(kept) == len(descriptors) and np.isfinite(descriptors).all()


@pytest.mark.parametrize("descriptor", ["gradients", "binary"])
def test_angles_count_within_a_turn_and_none_is_upright(scene: np.ndarray, descriptor: str) -> None:
    for same, angle in ((405.0, 45.0), (-90.0, 270.0), (-1.0, 0.0)):
        given, expected = (describe(scene, keypoint(angle=a), False, descriptor) for a in (same, angle))
        np.testing.assert_array_equal(given[1], expected[1])
        assert given[0].angle[0] == np.float32(same)
