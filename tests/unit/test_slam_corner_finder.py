"""Corners view by view: what one view shows, or whether it shows anything, is nothing to the others."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from slam_worlds import folded

from facetcam.slam.camera.corner_finder import CornerFinder
from facetcam.slam.camera.frame import Corners, make_frame
from facetcam.slam.camera.optics import Optics
from facetcam.slam.config import SlamConfig
from facetcam.slam.relative_pose.pairs import Pairs, alike, match_corners

Image = NDArray[np.uint8]

FEATURES = 400


@pytest.fixture(scope="module")
def optics() -> Optics:
    return Optics(folded(), 8.0)


@pytest.fixture(scope="module")
def plain_room(optics: Optics) -> NDArray[np.float64]:
    """Faint, soft patches on bright walls, and a few things that are dark."""
    rng = np.random.default_rng(3)
    height, width = optics.mask.shape
    coarse = rng.uniform(130.0, 180.0, (height // 12, width // 12))
    coarse[rng.random(coarse.shape) < 0.03] = 20.0
    image = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_NEAREST)
    return np.asarray(cv2.GaussianBlur(image, (0, 0), 1.5) + rng.normal(0.0, 0.3, image.shape))


def corners_of(optics: Optics, image: NDArray[np.float64]) -> Corners:
    frame = make_frame(np.clip(np.rint(image), 0, 255).astype(np.uint8), 0.0, optics.rig.size)
    return CornerFinder(optics, FEATURES)(frame)


def share_kept(before: Corners, after: Corners, view: int) -> float:
    """Share of a view's corners that are found again within a pixel."""
    a, b = (c.pixels[c.views == view] for c in (before, after))
    return float(np.mean(np.linalg.norm(a[:, None] - b[None], axis=2).min(axis=1, initial=np.inf) < 1.0))


@pytest.mark.parametrize("shown", [0.0, 255.0])
def test_blank_views_take_no_corners_from_the_others(
    optics: Optics, plain_room: NDArray[np.float64], shown: float
) -> None:
    kept = (0, optics.n_views - 1)
    blank = ~np.isin(optics.rig.labels(), kept)
    before = corners_of(optics, plain_room)
    after = corners_of(optics, np.where(blank, shown, plain_room))
    assert not np.any(np.isin(after.views, np.setdiff1d(np.arange(optics.n_views), kept)))
    for view in kept:
        assert np.count_nonzero(before.views == view) > 50
        assert share_kept(before, after, view) > 0.75  # coarse scales see the seam


def test_a_view_in_a_tenth_of_the_light_keeps_its_corners(
    optics: Optics, plain_room: NDArray[np.float64]
) -> None:
    contrasty = 150.0 + 4.0 * (plain_room - 150.0)
    dim = np.where(optics.rig.labels() == 1, 0.1 * contrasty, contrasty)
    before, after = corners_of(optics, contrasty), corners_of(optics, dim)
    assert share_kept(before, after, 1) > 0.6  # grey values are whole numbers
    assert share_kept(before, after, 0) > 0.95


def test_all_views_together_have_as_many_corners_as_are_asked_for(
    optics: Optics, plain_room: NDArray[np.float64]
) -> None:
    corners = corners_of(optics, plain_room)
    assert 0.8 * FEATURES < len(corners) <= FEATURES + optics.n_views
    np.testing.assert_array_equal(corners.views, optics.view_of(corners.pixels))


def lattice(optics: Optics, phase: int) -> NDArray[np.float64]:
    """A bright wall with dark spots, and upright dashed lines whose dashes lie `phase` pixels lower.

    So sensors show lines that are thinner than their pixels, and where the dashes are says nothing.
    """
    height, width = optics.mask.shape
    y, x = np.mgrid[:height, :width]
    image = np.full((height, width), 170.0)
    image[(x % 40 == 20) & ((y - phase) % 5 < 3)] = 90.0
    coarse = np.random.default_rng(4).uniform(20.0, 170.0, (height // 4 + 1, width // 4 + 1))
    spots = np.kron(coarse, np.ones((4, 4)))[:height, :width]
    image = np.where((x % 40 < 12) & (y % 90 < 12), spots, image)
    return np.asarray(image + np.random.default_rng(phase).normal(0.0, 0.5, image.shape))


def test_corners_on_dashed_lines_are_known_to_slide(optics: Optics) -> None:
    corners = corners_of(optics, lattice(optics, 0))
    column, row = corners.pixels.T
    on_line = np.abs(column % 40 - 20) < 3
    on_spot = ((column + 2) % 40 < 16) & ((row + 2) % 90 < 16)
    assert on_line.sum() > 50 and on_spot.sum() > 50
    assert corners.slide[on_line].mean() > 0.95
    assert corners.slide[on_spot].mean() < 0.05


def test_a_few_of_them_are_enough_and_all_others_stay(optics: Optics) -> None:
    corners = corners_of(optics, lattice(optics, 0))
    cell = int(3 * np.sqrt(np.count_nonzero(optics.mask) / FEATURES))
    home = np.column_stack([corners.views, corners.pixels // cell])
    in_cells = [np.unique(home[r], axis=0, return_counts=True)[1] for r in (corners.slide, ~corners.slide)]
    assert in_cells[0].max() == 3 < in_cells[1].max()


def test_they_say_nothing_of_how_the_rig_moves(optics: Optics) -> None:
    a, b = (corners_of(optics, lattice(optics, phase)) for phase in (0, 2))
    blind = Pairs.linked(a, b, alike(a, b, SlamConfig()))
    assert np.mean(blind.move()) > 0.2  # the dashes have moved, the wall has not
    pairs = match_corners(a, b, SlamConfig())
    assert len(pairs) > 40
    assert np.mean(pairs.move()) < 0.02
