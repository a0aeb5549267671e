"""Keypoints as arrays: a thousand points are six arrays, not a thousand objects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam.errors import FacetcamError

Floats = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Keypoints:
    """Image points with scale and direction, in the conventions of ``cv2.KeyPoint``.

    Attributes
    ----------
    xy : (N, 2) float32
        Pixels; (0, 0) is the centre of the first pixel.
    size : (N,) float32
        Diameter of the neighbourhood, pixels.
    angle : (N,) float32
        Direction in degrees [0, 360), x towards y (clockwise as the image is shown).
    response : (N,) float32
        Strength; comparable only within one image.
    level : (N,) int32
        Index of the scale that answers most, 0 is the finest.
    """

    xy: Floats
    size: Floats
    angle: Floats
    response: Floats
    level: NDArray[np.int32]

    def __post_init__(self) -> None:
        if self.xy.ndim != 2 or self.xy.shape[1] != 2:
            raise FacetcamError(f"Keypoints.xy: expected shape (N, 2), got {self.xy.shape}")
        for field in fields(self)[1:]:
            shape = getattr(self, field.name).shape
            if shape != (len(self.xy),):
                raise FacetcamError(f"Keypoints.{field.name}: expected shape ({len(self.xy)},), got {shape}")

    @classmethod
    def from_rows(cls, rows: Floats) -> Keypoints:
        """Make keypoints from rows (N, 6): x, y, size, angle, response, level."""
        size, angle, response = (rows[:, i].copy() for i in (2, 3, 4))
        return cls(rows[:, :2].copy(), size, angle, response, rows[:, 5].astype(np.int32))

    @classmethod
    def at(cls, xy: Floats, size: float = 12.0, angle: float = 0.0) -> Keypoints:
        """Make keypoints of one size and direction at given places (N, 2)."""
        rows = np.zeros((len(xy), 6), np.float32)
        rows[:, :2], rows[:, 2], rows[:, 3] = xy, size, angle
        return cls.from_rows(rows)

    @classmethod
    def joined(cls, parts: Sequence[Keypoints]) -> Keypoints:
        """Put keypoints of one image one after another."""
        parts = [cls.at(np.empty((0, 2), np.float32)), *parts]
        return cls(*(np.concatenate([getattr(p, field.name) for p in parts]) for field in fields(cls)))

    @classmethod
    def from_cv2(cls, keypoints: Sequence[Any]) -> Keypoints:
        """Convert a sequence of ``cv2.KeyPoint``; the level is the lowest byte of its octave."""
        rows = [(*k.pt, k.size, k.angle, k.response, k.octave & 255) for k in keypoints]
        return cls.from_rows(np.array(rows, np.float32).reshape(-1, 6))

    def to_cv2(self) -> list[Any]:
        """Convert to a list of ``cv2.KeyPoint``."""
        return [
            cv2.KeyPoint(float(x), float(y), float(size), float(angle), float(response), int(level))
            for (x, y), size, angle, response, level in zip(
                self.xy, self.size, self.angle, self.response, self.level, strict=True
            )
        ]

    def __len__(self) -> int:
        return len(self.xy)

    def __getitem__(self, index: slice | NDArray[Any]) -> Keypoints:
        """Select by slice, boolean mask or index array."""
        return Keypoints(*(getattr(self, field.name)[index] for field in fields(self)))
