"""Corners and edges in the patches of map points."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from facetcam.slam.map.edges import are_corners
from facetcam.slam.map.points import PATCH_SIZE

FINE = 4


def wedge(turn: float, opening: float, shift: float = 0.0) -> NDArray[np.uint8]:
    """A patch with a bright wedge whose tip is in its middle, or to the right of it, in grey noise of one."""
    angles = turn + np.linspace(0.0, opening, 9)
    rim = 90.0 * np.column_stack([np.cos(angles), np.sin(angles)])
    shape = np.vstack([[0.0, 0.0], rim]) + PATCH_SIZE / 2 + [shift, 0.0]
    fine = np.full((FINE * PATCH_SIZE, FINE * PATCH_SIZE), 60.0, np.float32)
    cv2.fillPoly(fine, [np.rint(FINE * shape).astype(np.int32)], 180.0)
    patch = cv2.resize(fine, (PATCH_SIZE, PATCH_SIZE), interpolation=cv2.INTER_AREA)
    return np.rint(patch + np.random.default_rng(1).normal(0.0, 1.0, patch.shape)).astype(np.uint8)


@pytest.mark.parametrize("turn", [0.0, 0.4, 1.2, 1.5708, 2.5])
def test_a_straight_edge_is_no_corner_and_a_bent_one_is(turn: float) -> None:
    patches = np.stack([wedge(turn, np.pi), wedge(turn, 0.5 * np.pi), wedge(turn, 1.4 * np.pi)])
    np.testing.assert_array_equal(are_corners(patches, np.zeros((3, 2))), [False, True, True])


def test_it_is_asked_at_the_point_not_in_the_middle_of_the_patch() -> None:
    """The tip lies nine pixels to the right of the middle, through which one side runs."""
    patch = wedge(np.pi, 0.4 * np.pi, 9.0)[None]
    assert are_corners(patch, np.array([[9.0, 0.0]])).all()
    assert not are_corners(patch, np.zeros((1, 2))).any()


def test_nothing_is_no_corner() -> None:
    flat = np.full((2, PATCH_SIZE, PATCH_SIZE), 90, np.uint8)
    assert not are_corners(flat, np.zeros((2, 2))).any()
    assert len(are_corners(flat[:0], np.zeros((0, 2)))) == 0
