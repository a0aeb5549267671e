"""The detectors that are compared: ours, the paper's, and OpenCV's with low thresholds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np

from facetcam.config import nearest
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


def peers(names: list[str] | None = None, most: int = 6000, enough: int = 2000) -> dict[str, Peer]:
    """Make detectors by name, all of them by default.

    Parameters
    ----------
    names : list of str, optional
        Which.
    most : int
        Points that detectors with a limit may give.
    enough : int
        OpenCV's detectors lower their threshold until they give so many points, or as far as they can.

    Raises
    ------
    ConfigError
        An unknown name.
    """

    def opencv(
        make: Callable[[Any], Any], thresholds: tuple[float, ...], norm: int | None = None
    ) -> Callable[[], Peer]:
        return lambda: _opencv([make(threshold) for threshold in thresholds], enough, norm)

    fast, agast, mser = cv2.FastFeatureDetector, _extra("AgastFeatureDetector"), cv2.MSER
    akaze, kaze, brisk, contrib = _extra("AKAZE"), _extra("KAZE"), _extra("BRISK"), cv2.xfeatures2d
    gftt, bits, floats = cv2.GFTTDetector, cv2.NORM_HAMMING, cv2.NORM_L2
    makers: dict[str, Callable[[], Peer]] = {
        "SIICF": lambda: _ours(SIICF.create(max_features=most)),
        "SIICF binary": lambda: _ours(SIICF.create(max_features=most, descriptor="binary")),
        "SIICF all": lambda: _ours(SIICF.create(max_features=most, threshold=0.0)),
        "SIICF paper": lambda: _ours(SIICF.create(mode="paper", max_features=most)),
        "LoG": lambda: _ours(LoG.create(max_features=most, threshold=3.0)),
        "DoG": lambda: _ours(DoG.create(max_features=most, threshold=0.01)),
        "Harris-Laplace": lambda: _ours(HarrisLaplace.create(max_features=most, threshold=1e-4)),
        "GFTT": opencv(lambda t: gftt.create(most, t, 3), (1e-5, 1e-8)),
        "Harris": opencv(lambda t: gftt.create(most, t, 3, 3, True, 0.04), (1e-6, 1e-12)),
        "FAST": opencv(fast.create, (5, 1)),
        "AGAST": opencv(agast.create, (5, 1)),
        "MSER": opencv(lambda t: mser.create(1, 20, 14400, t, 0.02), (0.25, 0.5, 1.0)),
        "TBMR": opencv(contrib.TBMR.create, (60, 10)),
        "Blob": opencv(_blobs, (5, 2)),
        "Star": opencv(lambda t: contrib.StarDetector.create(responseThreshold=t), (10, 2, 0)),
        "MSD": opencv(lambda t: contrib.MSDDetector.create(m_th_saliency=t), (250, 25, 0)),
        "ORB": opencv(lambda t: cv2.ORB.create(most, fastThreshold=t), (5, 1), bits),
        "SIFT": opencv(lambda t: cv2.SIFT.create(most, contrastThreshold=t), (0.01, 0.001), floats),
        "KAZE": opencv(lambda t: kaze.create(threshold=t), (1e-5, 1e-7), floats),
        "AKAZE": opencv(lambda t: akaze.create(threshold=t), (1e-5, 1e-7), bits),
        "BRISK": opencv(brisk.create, (10, 3, 1), bits),
    }
    for name in names or []:
        if name not in makers:
            raise ConfigError(f"unknown detector {name!r}; {nearest(name, makers)}")
    return {name: makers[name]() for name in names or makers}


def _extra(name: str) -> Any:
    """Class of OpenCV that moved to `cv2.xfeatures2d` in OpenCV 5."""
    return getattr(cv2, name, None) or getattr(cv2.xfeatures2d, name)


def _blobs(step: float) -> Any:
    """Blobs of any shape and shade, by binary images `step` grey values apart."""
    parameters = cv2.SimpleBlobDetector.Params()
    parameters.thresholdStep, parameters.minRepeatability = step, 1
    parameters.minArea, parameters.minDistBetweenBlobs = 5, 3
    parameters.filterByColor = parameters.filterByConvexity = parameters.filterByInertia = False
    return cv2.SimpleBlobDetector.create(parameters)


def _ours(detector: Detector) -> Peer:
    return Peer(
        detector.detect,
        lambda image, top: detector.compute(image, detector.detect(image)[:top]),
        detector.defaultNorm(),
    )


def _opencv(detectors: list[Any], enough: int, norm: int | None) -> Peer:
    """Wrap a detector of OpenCV at falling thresholds; without the norm of its descriptor it gets ours."""

    def points(image: Image) -> list[Any]:
        found: list[Any] = []
        for detector in detectors:
            found = list(detector.detect(image, None))
            if len(found) >= enough:
                break
        return sorted(found, key=lambda point: (-point.response, -point.size, point.pt))

    def described(image: Image, top: int) -> Described:
        if norm is None:
            return describe(image, _with_angles(image, Keypoints.from_cv2(points(image)[:top])))
        kept, descriptors = detectors[-1].compute(image, points(image)[:top])
        if descriptors is None:
            descriptors = np.empty((0, detectors[-1].descriptorSize()), np.uint8)
        return Keypoints.from_cv2(kept), descriptors

    own = description("gradients").norm if norm is None else norm
    return Peer(lambda image: Keypoints.from_cv2(points(image)), described, own)


def _with_angles(image: Image, keypoints: Keypoints) -> Keypoints:
    """Give points a direction, and a patch to those whose size is only that of their test.

    Of detectors without a descriptor only TBMR has directions, and those are radians of its ellipses.
    """
    angle = centroid_angles(image, keypoints.xy)
    return replace(keypoints, angle=angle, size=np.maximum(keypoints.size, np.float32(_LEAST_SIZE)))
