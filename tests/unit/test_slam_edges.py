"""Corners and edges in the patches of map points."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from facetcam import _core
from facetcam.slam.camera.edges import are_corners, patch_edges
from facetcam.slam.camera.patches import PATCH_SIZE

FINE = 4
RADIUS, APART = 7, 5.0


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


def dashed(turn: float, period: float) -> NDArray[np.uint8]:
    """A dashed dark line through the middle of a patch, in grey noise of one."""
    y, x = (np.mgrid[: FINE * PATCH_SIZE, : FINE * PATCH_SIZE] + 0.5) / FINE - PATCH_SIZE / 2
    along, aside = np.cos(turn) * x + np.sin(turn) * y, np.cos(turn) * y - np.sin(turn) * x
    fine = np.where((np.abs(aside) < 0.8) & (np.mod(along, period) < 0.6 * period), 60.0, 180.0)
    patch = cv2.resize(fine, (PATCH_SIZE, PATCH_SIZE), interpolation=cv2.INTER_AREA)
    return np.rint(patch + np.random.default_rng(1).normal(0.0, 1.0, patch.shape)).astype(np.uint8)


@pytest.mark.parametrize("turn", [0.1, 0.8, 1.4, 2.6])
@pytest.mark.parametrize("period", [3.5, 5.0, 7.0])
def test_dashes_are_an_edge_along_their_line(turn: float, period: float) -> None:
    """As thin lines are seen: gradients have two directions, yet a patch finds its neighbour's place."""
    patch, middle = dashed(turn, period)[None], np.zeros((1, 2))
    assert not are_corners(patch, middle).any()
    (edge,) = patch_edges(patch, middle, np.eye(2)[None])
    assert np.linalg.norm(edge) > 0.9
    assert abs(edge @ [-np.sin(turn), np.cos(turn)]) < 0.25 * np.linalg.norm(edge)


def test_what_repeats_farther_away_than_patches_slide_is_a_corner() -> None:
    assert are_corners(dashed(0.4, 26.0)[None], np.zeros((1, 2))).all()


def test_likeness_is_what_opencv_correlates() -> None:
    rng = np.random.default_rng(2)
    patches = rng.integers(0, 256, (40, PATCH_SIZE, PATCH_SIZE), dtype=np.uint8)
    offsets = rng.uniform(-3.0, 3.0, (40, 2)).astype(np.float32)
    kernel = np.array([0.25, 0.5, 0.25])
    found = _core.self_similarity(patches, offsets, RADIUS, APART, 2)
    for patch, offset, (correlation, *way) in zip(patches, offsets, found):
        smooth = cv2.sepFilter2D(patch, cv2.CV_32F, kernel, kernel, borderType=cv2.BORDER_REPLICATE)
        x, y = PATCH_SIZE // 2 + np.rint(offset).astype(int) - RADIUS
        window = smooth[y : y + 2 * RADIUS + 1, x : x + 2 * RADIUS + 1]
        score = cv2.matchTemplate(smooth, window, cv2.TM_CCOEFF_NORMED)
        v, u = np.indices(score.shape)
        score[np.hypot(u - x, v - y) < APART] = -1.0
        best = np.unravel_index(np.argmax(score), score.shape)
        assert correlation == pytest.approx(score.max(), abs=2e-3)
        np.testing.assert_array_equal(np.add(way, [x, y])[::-1], best)


def test_nothing_is_like_a_flat_patch() -> None:
    flat, middle = np.full((1, PATCH_SIZE, PATCH_SIZE), 255, np.uint8), np.zeros((1, 2), np.float32)
    found = _core.self_similarity(flat, middle, RADIUS, APART, 1)
    np.testing.assert_array_equal(found, [[-1.0, 0.0, 0.0]])


def test_a_window_that_is_too_large_is_refused() -> None:
    patch, middle = np.zeros((1, PATCH_SIZE, PATCH_SIZE), np.uint8), np.zeros((1, 2), np.float32)
    with pytest.raises(ValueError, match="radius"):
        _core.self_similarity(patch, middle, RADIUS + 1, APART, 1)
