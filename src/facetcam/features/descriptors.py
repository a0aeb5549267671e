"""Descriptors of keypoints, turned by their angle: histograms of gradients, or 256 bits.

``gradients`` match over larger changes of scale and viewpoint; ``binary`` ones are ten times smaller and
faster. docs/benchmarks-detectors.md compares them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam.config import nearest
from facetcam.errors import ConfigError, FacetcamError
from facetcam.features.images import Image, as_grey
from facetcam.features.keypoints import Keypoints

Described = tuple[Keypoints, NDArray[Any]]

DESCRIPTOR_BYTES = 32  # of a binary one
_GRADIENT_WORDS = 128
_SIFT_WIDTH_PER_SIZE = 6.0  # how OpenCV's SIFT lays its patch out
_SIFT_SIGMA = 1.6
# Widths of patches in sizes of the keypoint, by measurement on light, JPEG, zoom, viewpoint and noise.
_POOLED_WIDTHS = (1.5, 3.0, 6.0)
_BINARY_WIDTH = 3.5
_FARTHEST = 1e9


@dataclass(frozen=True, slots=True)
class Description:
    """How one kind of descriptors is made and compared, in OpenCV's terms.

    `compute` gives the indices of the keypoints that could be described, and their descriptors.
    """

    size: int
    dtype: int
    norm: int
    compute: Callable[[Image, Keypoints], tuple[NDArray[np.intp], NDArray[Any]]]


def describe(
    image: Image, keypoints: Keypoints, flipped: bool = False, descriptor: str = "gradients"
) -> Described:
    """Describe keypoints by the patch round them, turned by their angle.

    Parameters
    ----------
    image : (H, W) or (H, W, 3)
        The image in which the keypoints were found.
    keypoints : Keypoints
        Of N points; their angles and sizes are respected. An angle of -1, OpenCV's for none, is upright.
    flipped : bool
        The points were seen through an odd number of mirrors: the patch is flipped left to right first,
        so that its descriptor equals the one of the same point seen directly.
    descriptor : str
        "gradients" or "binary".

    Returns
    -------
    Keypoints
        The M <= N points whose patch could be described, unchanged.
    descriptors : (M, 128) float32 or (M, 32) uint8
        Gradients have length 1 (0 where the patch is flat) and are compared by Euclidean distance, binary
        ones by Hamming distance.

    Raises
    ------
    FacetcamError
        An unknown descriptor, an image of wrong type or shape, or keypoints that are not finite.
    """
    kind, grey, patches = description(descriptor), as_bytes(as_grey(image)), _sound(keypoints)
    if flipped:
        grey, patches = np.ascontiguousarray(grey[:, ::-1]), _mirrored(patches, grey.shape[1])
    kept, descriptors = kind.compute(grey, patches)
    return keypoints[kept], descriptors


def _sound(keypoints: Keypoints) -> Keypoints:
    """Check that keypoints are numbers, and bring angles within a turn: OpenCV crashes on others."""
    numbers = np.column_stack([keypoints.xy, keypoints.size, keypoints.angle])
    wrong = int(np.sum(~(np.abs(numbers) <= _FARTHEST).all(axis=1) | (keypoints.size < 0)))
    if wrong:
        raise FacetcamError(
            f"keypoints: {wrong} with a place, size or angle that is NaN or beyond {_FARTHEST:g}, "
            "or a negative size; leave them out"
        )
    turned = np.mod(keypoints.angle, np.float32(360))
    return replace(keypoints, angle=np.where(keypoints.angle == -1, np.float32(0), turned))


def description(descriptor: str) -> Description:
    """Look a kind of descriptors up by name; ConfigError where there is none."""
    if descriptor not in _KINDS:
        raise ConfigError(f"descriptor: unknown kind {descriptor!r}; {nearest(descriptor, list(_KINDS))}")
    return _KINDS[descriptor]


def as_bytes(grey: Image) -> NDArray[np.uint8]:
    """Stretch the values of other types to 8 bits between their 0.1 % and 99.9 % quantiles."""
    if grey.dtype == np.uint8:
        return np.ascontiguousarray(grey)
    low, high = np.quantile(grey, (0.001, 0.999))
    scaled = (grey.astype(np.float32) - low) * (255.0 / max(high - low, 1e-12))
    stretched: NDArray[np.uint8] = np.clip(scaled + 0.5, 0, 255).astype(np.uint8)
    return stretched


def _gradients(grey: Image, keypoints: Keypoints) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
    """SIFT's histograms of gradients pooled over patches of three sizes, and their roots.

    A corner's size is known to half an octave; pooling makes the descriptor bear that.

    Source: D. Lowe, "Distinctive image features from scale-invariant keypoints", 2004; J. Dong, S. Soatto,
    "Domain-size pooling in local descriptors: DSP-SIFT", 2015, https://arxiv.org/abs/1412.8556; roots:
    R. Arandjelovic, A. Zisserman, "Three things everyone should know to improve object retrieval", 2012.
    """
    everyone = np.arange(len(keypoints))
    if len(keypoints) == 0:
        return everyone, np.empty((0, _GRADIENT_WORDS), np.float32)
    coarsest = int(np.log2(min(grey.shape)))
    patches = [patch for width in _POOLED_WIDTHS for patch in _sift_patches(keypoints, width, coarsest)]
    _, histograms = cv2.SIFT.create(nOctaveLayers=1).compute(grey, patches)
    pooled = _shares(histograms.reshape(len(_POOLED_WIDTHS), len(keypoints), -1)).sum(axis=0)
    return everyone, np.sqrt(_shares(pooled))


def _sift_patches(keypoints: Keypoints, width: float, coarsest: int) -> list[Any]:
    """Keypoints of OpenCV whose SIFT patch is `width` sizes wide, from the octave to match if there is."""
    points = keypoints.to_cv2()
    for point in points:
        point.size *= width / _SIFT_WIDTH_PER_SIZE
        octave = round(float(np.log2(max(point.size, 1e-3) / 2 / _SIFT_SIGMA)))
        point.octave = min(max(0, octave), coarsest)
    return points


def _shares(histograms: NDArray[np.float32]) -> NDArray[np.float32]:
    """Scale every histogram to the sum 1; empty ones stay."""
    return np.asarray(histograms / np.maximum(histograms.sum(axis=-1, keepdims=True), 1e-9))


def _binary(grey: Image, keypoints: Keypoints) -> tuple[NDArray[np.intp], NDArray[np.uint8]]:
    """TEBLID of 256 bits.

    Source: I. Suarez, J. M. Buenaposada, L. Baumela, "Revisiting binary local image description for resource
    limited devices", 2021, https://arxiv.org/abs/2108.08380.
    """
    points = keypoints.to_cv2()
    for index, point in enumerate(points):
        point.class_id = index
    kept, descriptors = cv2.xfeatures2d.TEBLID.create(_BINARY_WIDTH).compute(grey, points)
    if descriptors is None:
        return np.empty(0, np.intp), np.empty((0, DESCRIPTOR_BYTES), np.uint8)
    return np.array([point.class_id for point in kept], np.intp), descriptors


_KINDS = {
    "gradients": Description(_GRADIENT_WORDS, cv2.CV_32F, cv2.NORM_L2, _gradients),
    "binary": Description(DESCRIPTOR_BYTES, cv2.CV_8U, cv2.NORM_HAMMING, _binary),
}


def _mirrored(keypoints: Keypoints, width: int) -> Keypoints:
    """Return the keypoints as they lie in the image flipped left to right."""
    xy = keypoints.xy * np.array([-1, 1], np.float32) + np.array([width - 1, 0], np.float32)
    angle = np.mod(180.0 - keypoints.angle, 360.0).astype(np.float32)
    return Keypoints(xy, keypoints.size, angle, keypoints.response, keypoints.level)
