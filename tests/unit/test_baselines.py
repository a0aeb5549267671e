"""The baseline detectors: same interface, right places on blobs and corners."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from facetcam.errors import ConfigError, FacetcamError
from facetcam.features import SIICF, DoG, HarrisLaplace, LoG

DETECTORS = [LoG, DoG, HarrisLaplace]


@pytest.fixture(scope="module")
def blobs() -> tuple[np.ndarray, np.ndarray]:
    """Gaussian spots of sigma 4 at known places between the pixels."""
    places = np.array([[40.3, 50.7], [90.0, 45.5], [150.2, 60.4], [60.6, 120.0], [140.5, 130.25]])
    v, u = np.mgrid[0:180, 0:200]
    image = np.full((180, 200), 60.0)
    for x, y in places:
        image += 120 * np.exp(-((u - x) ** 2 + (v - y) ** 2) / (2 * 4.0**2))
    return np.rint(image).astype(np.uint8), places


@pytest.mark.parametrize("detector", [LoG, DoG])
def test_spots_are_found_with_their_size(detector: type, blobs: tuple[np.ndarray, np.ndarray]) -> None:
    image, places = blobs
    found = detector.create().detect(image)
    distance = np.linalg.norm(found.xy[:, None] - places, axis=2)
    found = found[distance.argmin(axis=0)]
    assert distance.min(axis=0).max() < 0.15
    # A spot of sigma 4 answers most at scale 4; the scales are a factor of up to 1.4 apart.
    scale = found.size / (2 * np.sqrt(2)) if detector is LoG else found.size / 2
    assert np.all((scale > 4 / 1.45) & (scale < 4 * 1.45))


def test_harris_laplace_finds_corners_of_squares() -> None:
    image = np.full((200, 240), 50, np.uint8)
    corners = []
    for x, y, side in [(30, 30, 40), (120, 50, 60), (60, 120, 50)]:
        image[y : y + side, x : x + side] = 200
        corners += [(x + i, y + j) for i in (-0.5, side - 0.5) for j in (-0.5, side - 0.5)]
    found = HarrisLaplace.create().detect(cv2.GaussianBlur(image, (0, 0), 1.0))
    distance = np.linalg.norm(found.xy[:, None] - np.array(corners), axis=2)
    assert distance.min(axis=0).max() < 3.0  # OpenCV gives whole pixels, one to two off the corner


@pytest.mark.parametrize("detector", DETECTORS)
def test_interface(detector: type, blobs: tuple[np.ndarray, np.ndarray]) -> None:
    image, _ = blobs
    found = detector.create(max_features=3).detect(image)
    assert len(found) <= 3
    order = np.lexsort((found.xy[:, 0], found.xy[:, 1], -found.response))
    np.testing.assert_array_equal(order, np.arange(len(found)))
    assert len(detector.create().detect(image, np.zeros(image.shape, np.uint8))) == 0
    assert len(detector.create().detect(np.zeros((5, 4), np.uint8))) == 0
    _, descriptors = detector.create().detectAndCompute(image)
    assert descriptors.dtype == np.float32
    with pytest.raises(ConfigError, match="did you mean 'threshold'"):
        detector.create(treshold=1.0)
    with pytest.raises(ConfigError, match="max_features must be at least 1"):
        detector.create(max_features=-1)
    with pytest.raises(FacetcamError, match="expected shape"):
        detector.create().detect(image[0])


@pytest.mark.parametrize("mode", ["robust", "paper"])
def test_opencv_properties(mode: str) -> None:
    detector = SIICF.create(mode=mode)
    assert (detector.descriptorSize(), detector.defaultNorm()) == (128, cv2.NORM_L2)
    assert detector.descriptorType() == cv2.CV_32F
    detector = SIICF.create(mode=mode, descriptor="binary")
    assert (detector.descriptorSize(), detector.defaultNorm()) == (32, cv2.NORM_HAMMING)
    assert detector.descriptorType() == cv2.CV_8U
