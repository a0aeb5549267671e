"""What all detectors share: the interface of ``cv2.Feature2D`` and checked parameters."""

from __future__ import annotations

import dataclasses
from abc import ABC, abstractmethod
from typing import Any, ClassVar, Self

import numpy as np

from facetcam.config import from_mapping, nearest
from facetcam.errors import ConfigError
from facetcam.features.descriptors import Described, describe, description
from facetcam.features.images import Image, Mask, as_grey, as_mask
from facetcam.features.keypoints import Keypoints

MOST_FEATURES = 10**9  # that native code is asked for


class Detector(ABC):
    """A keypoint detector whose parameters are the fields of a frozen dataclass.

    Parameters
    ----------
    options
        An instance of the class's ``Options``; `create` makes it from keywords.
    """

    Options: ClassVar[type[Any]]

    def __init__(self, options: Any = None) -> None:
        self.options = self.Options() if options is None else options

    @classmethod
    def create(cls, **params: Any) -> Self:
        """Make a detector from keyword parameters.

        Raises
        ------
        ConfigError
            An unknown parameter (the message names the nearest one); a value of wrong type or range.
        """
        known = [field.name for field in dataclasses.fields(cls.Options)]
        for name in params:
            if name not in known:
                raise ConfigError(f"{cls.__name__}: unknown parameter {name!r}; {nearest(name, known)}")
        return cls(from_mapping(cls.Options, params, cls.__name__))

    def detect(self, image: Image, mask: Image | None = None) -> Keypoints:
        """Find keypoints, strongest first.

        Parameters
        ----------
        image : (H, W) or (H, W, 3) uint8, uint16, float32 or float64
            Grey or BGR, any strides.
        mask : (H, W) uint8 or bool, optional
            Points lie where it is nonzero.

        Raises
        ------
        FacetcamError
            An image or mask of wrong type or shape, or with pixels that are not finite.
        """
        grey = as_grey(image)
        return self._detect(grey, as_mask(mask, grey.shape))

    @property
    def descriptor(self) -> str:
        """Kind of the descriptors, see `describe`."""
        return str(getattr(self.options, "descriptor", "gradients"))

    def compute(self, image: Image, keypoints: Keypoints) -> Described:
        """Describe keypoints; see `describe`."""
        return describe(image, keypoints, descriptor=self.descriptor)

    def detectAndCompute(self, image: Image, mask: Image | None = None) -> Described:
        """Find and describe keypoints."""
        return self.compute(image, self.detect(image, mask))

    def descriptorSize(self) -> int:
        """Numbers of one descriptor: its columns."""
        return description(self.descriptor).size

    def descriptorType(self) -> int:
        """OpenCV's type of the descriptors."""
        return description(self.descriptor).dtype

    def defaultNorm(self) -> int:
        """OpenCV's norm to compare descriptors by."""
        return description(self.descriptor).norm

    @abstractmethod
    def _detect(self, grey: Image, mask: Mask | None) -> Keypoints:
        """Find keypoints in a checked grey image."""


def require(owner: str, name: str, value: float | None, low: float, high: float = np.inf) -> None:
    """Raise ConfigError unless the value is a number in [low, high]."""
    if value is None or isinstance(value, bool) or not isinstance(value, int | float | np.number):
        raise ConfigError(f"{owner}: {name} must be a number, got {value!r}")
    if not low <= value <= high:
        limit = f"at least {low:g}" if np.isinf(high) else f"between {low:g} and {high:g}"
        raise ConfigError(f"{owner}: {name} must be {limit}, got {value!r}")
