"""Starts of a rig that turns on the spot: wheels say so, and mirrors beside its axis give the parallax."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from slam_worlds import by_wheels, distinct_corners, folded, single, spoiled, true_pairs

from facetcam.geometry import se3
from facetcam.slam.camera.optics import Optics
from facetcam.slam.config import SlamConfig
from facetcam.slam.relative_pose.confirmed_motion import confirmed_motion, enough_parallax
from facetcam.slam.relative_pose.degenerate import on_the_spot
from facetcam.slam.relative_pose.doubt import is_denied
from facetcam.slam.relative_pose.two_frames import polished

Array = NDArray[np.float64]


def turned(degrees: float, way: float = 0.0) -> Array:
    """A turn to the left, after so many metres straight on."""
    return se3.exp([0.0, 0.0, 0.0, 0.0, way, 0.0]) @ se3.exp([0.0, 0.0, np.radians(degrees), 0.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def ryu() -> Optics:
    return Optics(folded(), 8.0)


@pytest.mark.parametrize(
    ("degrees", "way", "spot"),
    [(15.0, 0.0, True), (15.0, 0.005, True), (15.0, 0.1, False), (0.0, 0.0, False), (1.0, 0.05, False)],
)
def test_a_turn_is_on_the_spot_where_it_moves_the_views_more_than_the_way(
    ryu: Optics, degrees: float, way: float, spot: bool
) -> None:
    assert on_the_spot(turned(degrees, way), ryu) == spot


def test_a_camera_on_the_axis_is_never_moved_by_a_turn() -> None:
    assert not on_the_spot(turned(40.0, 1e-6), Optics(single(), 8.0))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("way", [0.0, 0.004])
def test_the_tilt_is_that_of_the_images_and_the_rest_that_of_the_wheels(
    ryu: Optics, way: float, seed: int
) -> None:
    """Views that a turn moves sideways cannot tell it from a nearer world; the way is too short to tell."""
    rng, told = np.random.default_rng([41, seed]), turned(14.4, way)
    true = turned(14.0, way) @ se3.exp([0.04, -0.03, 0.0, 0.0, 0.0, 0.0])
    pairs = spoiled(true_pairs(ryu, true, rng), ryu, rng, 0.15, 0.3)
    T = confirmed_motion(pairs, by_wheels(told), ryu)
    assert T is not None
    off = np.degrees(se3.log(se3.inverse(true) @ T)[:3])
    assert np.linalg.norm(off[:2]) < 0.1
    assert abs(off[2]) < 0.5
    np.testing.assert_allclose(T[:3, 3], told[:3, 3], atol=1e-12)


@pytest.mark.parametrize("other", [turned(-14.0), turned(14.0, 0.6), se3.exp([0.3, 0.0, 0.2, 0.0, 0.0, 0.0])])
def test_images_that_show_another_motion_deny_the_turn(ryu: Optics, other: Array) -> None:
    rng = np.random.default_rng(42)
    pairs = spoiled(true_pairs(ryu, other, rng), ryu, rng, 0.1, 0.3)
    assert confirmed_motion(pairs, by_wheels(turned(14.0)), ryu) is None


@pytest.mark.parametrize(("wheels", "enough"), [(14.0, True), (10.0, False)])
def test_slight_parallax_is_enough_unless_it_goes_the_wrong_way(
    ryu: Optics, wheels: float, enough: bool
) -> None:
    """A turn shows no more before what is seen has left its view; by too short a turn all lies behind."""
    rng, true = np.random.default_rng(43), turned(14.0)
    pairs = true_pairs(ryu, true, rng)
    angle = pairs.parallax(true, ryu)[1]
    slight = pairs.take(np.flatnonzero((angle > 0.006) & (angle < 0.015))[:300])
    assert len(slight) > 100
    assert slight.count_good(true, ryu, 2.0).sum() == 0
    looks = rng.integers(0, 256, (len(slight), 32), np.uint8)
    a, b = (distinct_corners(p, slight.views, p, looks) for p in (slight.plane_a, slight.plane_b))
    nothing = np.empty(0, np.int64)
    assert enough_parallax(a, b, turned(wheels), ryu, SlamConfig(), nothing, several=True) == enough


def test_a_way_of_exactly_nothing_is_polished_and_denied_as_any(ryu: Optics) -> None:
    """The logarithm of its length had ended in an unexpected failure."""
    rng = np.random.default_rng(44)
    pairs = spoiled(true_pairs(ryu, turned(10.0, 0.3), rng), ryu, rng, 0.1, 0.3)
    assert np.all(np.isfinite(polished(turned(10.0), pairs, ryu)))
    assert not is_denied(pairs, turned(10.0, 0.3), ryu, wheels=turned(10.0))
