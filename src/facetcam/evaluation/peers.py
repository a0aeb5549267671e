"""The detectors that are compared: ours, the paper's, and OpenCV's with low thresholds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np

from facetcam.errors import ConfigError
from facetcam.features import SIICF, DoG, HarrisLaplace, Keypoints, LoG, describe
from facetcam.features.descriptors import Described, description
from facetcam.features.detector import Detector
from facetcam.features.images import Image
from facetcam.features.orientation import centroid_angles

_LEAST_SIZE = 12.0  # pixels, when a point is described


@dataclass(frozen=True, slots=True)
class Peer:
    """A detector (strongest first), the same with descriptors of the `top` points, and their norm."""

    detect: Callable[[Image], Keypoints]
    described: Callable[[Image, int], Described]
    norm: int = cv2.NORM_HAMMING


def peers(names: list[str] | None = None, most: int = 6000) -> dict[str, Peer]:
    """Make detectors by name, all of them by default; each may give up to `most` points.

    Raises
    ------
    ConfigError
        An unknown name.
    """
    makers: dict[str, Callable[[], Peer]] = {
        "SIICF": lambda: _ours(SIICF.create(max_features=most)),
        "SIICF binary": lambda: _ours(SIICF.create(max_features=most, descriptor="binary")),
        "SIICF all": lambda: _ours(SIICF.create(max_features=most, threshold=0.0)),
        "SIICF paper": lambda: _ours(SIICF.create(mode="paper", max_features=most)),
        "LoG": lambda: _ours(LoG.create(max_features=most, threshold=3.0)),
        "DoG": lambda: _ours(DoG.create(max_features=most, threshold=0.01)),
        "Harris-Laplace": lambda: _ours(HarrisLaplace.create(max_features=most, threshold=1e-4)),
        "GFTT": lambda: _opencv(cv2.GFTTDetector.create(most, 1e-5, 3)),
        "FAST": lambda: _opencv(cv2.FastFeatureDetector.create(5)),
        "ORB": lambda: _opencv(cv2.ORB.create(most, fastThreshold=5), own_descriptor=True),
        "SIFT": lambda: _opencv(cv2.SIFT.create(most, contrastThreshold=0.01), True, cv2.NORM_L2),
        "AKAZE": lambda: _opencv(_extra("AKAZE").create(threshold=1e-5), own_descriptor=True),
        "BRISK": lambda: _opencv(_extra("BRISK").create(10), own_descriptor=True),
    }
    unknown = [name for name in names or [] if name not in makers]
    if unknown:
        raise ConfigError(f"unknown detector {unknown[0]!r}; known are {', '.join(makers)}")
    return {name: makers[name]() for name in names or makers}


def _extra(name: str) -> Any:
    """Class of OpenCV that moved to `cv2.xfeatures2d` in OpenCV 5."""
    return getattr(cv2, name, None) or getattr(cv2.xfeatures2d, name)


def _ours(detector: Detector) -> Peer:
    return Peer(
        detector.detect,
        lambda image, top: detector.compute(image, detector.detect(image)[:top]),
        detector.defaultNorm(),
    )


def _opencv(detector: Any, own_descriptor: bool = False, norm: int | None = None) -> Peer:
    """Wrap a detector of OpenCV; without a descriptor of its own it gets ours."""
    if norm is None:
        norm = cv2.NORM_HAMMING if own_descriptor else description("gradients").norm

    def points(image: Image) -> list[Any]:
        return sorted(detector.detect(image, None), key=lambda point: -point.response)

    def described(image: Image, top: int) -> Described:
        if not own_descriptor:
            return describe(image, _with_angles(image, Keypoints.from_cv2(points(image)[:top])))
        kept, descriptors = detector.compute(image, points(image)[:top])
        if descriptors is None:
            descriptors = np.empty((0, detector.descriptorSize()), np.uint8)
        return Keypoints.from_cv2(kept), descriptors

    return Peer(lambda image: Keypoints.from_cv2(points(image)), described, norm)


def _with_angles(image: Image, keypoints: Keypoints) -> Keypoints:
    """Give points without a direction one, and a patch to those whose size is only that of their test."""
    angle = np.where(keypoints.angle < 0, centroid_angles(image, keypoints.xy), keypoints.angle)
    return replace(keypoints, angle=angle, size=np.maximum(keypoints.size, np.float32(_LEAST_SIZE)))
