"""Corners followed from frame to frame.

Over a step they are mistaken for others far less often than over the whole way, and more of them arrive.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from facetcam.slam.camera.frame import Corners
from facetcam.slam.config import SlamConfig
from facetcam.slam.relative_pose.pairs import alike

Index = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Links:
    """Which corners of the frame before, and of the one before that, are taken for which of this frame."""

    before: Index
    over_one: Index

    @classmethod
    def of(cls, corners: Corners, earlier: list[Corners], config: SlamConfig) -> Links:
        """Links to the corners of a frame from those of `earlier` ones, the last of them first."""
        links = [alike(c, corners, config) for c in earlier[:2]]
        return cls(*links, *((2 - len(links)) * [np.empty(0, np.int64)]))


def follow(count: int, links: list[Links]) -> Index:
    """Where the `count` corners of a frame are in the last of the frames after it, -1 where lost.

    A corner that one frame misses may be found again in the next.
    """
    lost = np.full(count, -1)
    last, here = lost, np.arange(count)
    for link in links:
        there = _step(here, link.before)
        last, here = here, _single(np.where(there >= 0, there, _step(last, link.over_one)))
    return here


def _step(rows: Index, link: Index) -> Index:
    there = np.full(len(rows), -1)
    there[rows >= 0] = link[rows[rows >= 0]]
    return there


def _single(rows: Index) -> Index:
    """Corners that two others have become are neither."""
    times = np.bincount(rows[rows >= 0], minlength=1)
    return np.where((rows >= 0) & (times[rows] > 1), -1, rows)
