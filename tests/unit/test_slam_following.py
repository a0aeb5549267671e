"""Corners followed from frame to frame, against a world in which each corner has a name."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from slam_worlds import distinct_corners

from facetcam.slam.camera.frame import Corners
from facetcam.slam.config import SlamConfig
from facetcam.slam.relative_pose.following import Links, follow

Index = NDArray[np.int64]


def frames(names: list[list[int]], looks: NDArray[np.uint8], step: float) -> list[Corners]:
    """Corners of these names, each of which moves on by a step in every frame."""
    out = []
    for k, row in enumerate(names):
        ids = np.array(row)
        pixels = np.column_stack([10.0 * ids + step * k, 5.0 * (ids % 7)])
        out.append(distinct_corners(pixels, np.zeros(len(ids), np.int8), pixels, looks[ids]))
    return out


def links_of(corners: list[Corners]) -> list[Links]:
    config = SlamConfig()
    return [
        Links.of(c, [corners[j] for j in (k - 1, k - 2) if j >= 0], config) for k, c in enumerate(corners)
    ]


@pytest.mark.parametrize("seed", range(3))
def test_corners_are_followed_to_themselves(seed: int) -> None:
    rng = np.random.default_rng([61, seed])
    looks = rng.integers(0, 256, (80, 32), np.uint8)
    seen = [rng.permutation(80)[:60].tolist() for _ in range(5)]
    corners = frames(seen, looks, 3.0)
    rows = follow(60, links_of(corners)[1:])
    arrived = np.flatnonzero(rows >= 0)
    assert len(arrived) > 15
    assert [seen[0][a] for a in arrived] == [seen[-1][b] for b in rows[arrived]]


def test_one_frame_may_miss_a_corner_but_not_two() -> None:
    looks = np.random.default_rng(62).integers(0, 256, (20, 32), np.uint8)
    others = list(range(4, 20))
    seen = [[*row, *others] for row in ([0, 1, 2, 3], [0, 1], [0, 2], [0, 2, 1, 3])]
    rows = follow(20, links_of(frames(seen, looks, 1.0))[1:])
    assert rows[:4].tolist() == [0, 2, 1, -1]
    assert rows[4:].tolist() == list(range(4, 20))


def test_two_that_become_one_are_lost() -> None:
    both = Links(np.array([0, 0, 1]), np.array([], np.int64))
    assert follow(3, [both]).tolist() == [-1, -1, 1]


def test_without_a_step_nothing_moves() -> None:
    assert follow(4, []).tolist() == [0, 1, 2, 3]
