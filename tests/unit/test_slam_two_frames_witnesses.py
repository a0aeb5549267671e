"""Views as witnesses of a motion between two frames: some stand or lie, some show little by themselves."""

from __future__ import annotations

import copy

import numpy as np
import pytest
from numpy.typing import NDArray
from slam_worlds import assert_motion, by_wheels, folded, single, spoiled, true_pairs

from facetcam.geometry import se3
from facetcam.slam.camera.optics import Optics
from facetcam.slam.relative_pose.confirmed_motion import confirmed_motion
from facetcam.slam.relative_pose.doubt import views_aside
from facetcam.slam.relative_pose.pairs import Pairs
from facetcam.slam.relative_pose.two_frames import MIN_MATCHES, estimate_motion

Array = NDArray[np.float64]

MOTION = se3.exp([0.02, -0.03, 0.12, 0.08, 0.3, 0.03])


@pytest.fixture(scope="module")
def ryu() -> Optics:
    return Optics(folded(), 8.0)


def still_in(pairs: Pairs, view: int, rng: np.random.Generator) -> Pairs:
    """The same pairs, with one view that shows in b what it showed in a."""
    frozen = pairs.plane_a + rng.normal(0.0, 0.1, pairs.plane_a.shape)
    return Pairs(pairs.views, pairs.plane_a, np.where((pairs.views == view)[:, None], frozen, pairs.plane_b))


def seen_moving_otherwise(pairs: Pairs, view: int, optics: Optics, rng: np.random.Generator) -> Pairs:
    """The same pairs, with one view full of things that move by themselves."""
    other = true_pairs(optics, MOTION @ se3.exp([0.0, 0.0, -0.3, 0.3, -0.2, 0.0]), rng)
    rows, others = pairs.views != view, other.views == view
    return Pairs(
        *(
            np.concatenate([getattr(pairs, name)[rows], getattr(other, name)[others]])
            for name in ("views", "plane_a", "plane_b")
        )
    )


@pytest.mark.parametrize("view", range(4))
def test_a_view_that_stands_or_moves_otherwise_bends_no_motion(ryu: Optics, view: int) -> None:
    rng = np.random.default_rng([32, view])
    pairs = spoiled(true_pairs(ryu, MOTION, rng), ryu, rng, 0.1, 0.3)
    wheels = MOTION @ se3.exp([0.0, 0.0, 0.03, 0.0, 0.0, 0.0])
    for lying in (still_in(pairs, view, rng), seen_moving_otherwise(pairs, view, ryu, rng)):
        assert (lying.views == view).sum() >= MIN_MATCHES
        assert views_aside(lying, MOTION, ryu).tolist() == [view]
        assert_motion(estimate_motion(lying, ryu), MOTION, degrees=0.15, direction=3.0)
        assert_motion(confirmed_motion(lying, by_wheels(wheels), ryu), MOTION, degrees=0.15, direction=3.0)


def half_wrong(optics: Optics, rng: np.random.Generator, counts: tuple[int, ...]) -> Pairs:
    """Pairs of the motion, so many of each view, of which the motion explains little more than half."""
    pairs = true_pairs(optics, MOTION, rng, 6000)
    rows = [np.flatnonzero(pairs.views == view)[:count] for view, count in enumerate(counts)]
    return spoiled(pairs.take(np.concatenate(rows)), optics, rng, 0.45, 0.3)


def test_two_views_tell_a_motion_though_nearly_half_of_their_pairs_are_wrong(ryu: Optics) -> None:
    for seed in range(3):
        pairs = half_wrong(ryu, np.random.default_rng(seed), (90, 90, 90, 90))
        assert 0.55 < pairs.fit(MOTION, ryu).mean() < 0.7
        assert_motion(estimate_motion(pairs, ryu), MOTION, degrees=0.3, direction=4.0)


def test_a_view_and_all_others_together_do_too(ryu: Optics) -> None:
    """Small views beside a large one had waited for six seconds, since none had thirty pairs by itself."""
    pairs = half_wrong(ryu, np.random.default_rng(5), (200, 28, 28, 28))
    assert pairs.count_good(MOTION, ryu, 2.0)[1:].max() < 30
    assert_motion(estimate_motion(pairs, ryu), MOTION, degrees=0.3, direction=4.0)


def test_one_view_does_not_with_so_many_wrong(ryu: Optics) -> None:
    pairs = half_wrong(ryu, np.random.default_rng(5), (200, 14, 14, 14))
    assert pairs.fit(MOTION, ryu).mean() > 0.55
    assert estimate_motion(pairs, ryu) is None


def test_views_that_overlap_are_one_view_then(ryu: Optics) -> None:
    pairs = half_wrong(ryu, np.random.default_rng(4), (130, 130))
    assert estimate_motion(pairs, ryu) is not None
    beside = copy.copy(ryu)
    beside.overlapping = [(0, 1)]
    assert estimate_motion(pairs, beside) is None


def test_the_only_view_is_never_set_aside() -> None:
    optics, rng = Optics(single(), 8.0), np.random.default_rng(33)
    pairs = true_pairs(optics, MOTION, rng)
    assert not len(views_aside(spoiled(pairs, optics, rng, 1.0, 0.3), MOTION, optics))
    assert not len(views_aside(still_in(pairs, 0, rng), MOTION, optics))


@pytest.mark.parametrize("view", range(4))
def test_a_view_full_of_people_does_not_outnumber_the_others(ryu: Optics, view: int) -> None:
    """Someone close walks through one view: its pairs shift by thirty pixels, as for a turn of the rig."""
    rng = np.random.default_rng([37, view])
    pairs = true_pairs(ryu, MOTION, rng, 10000)
    own = pairs.views == view
    shifted = np.where(own[:, None], pairs.plane_a + np.array([30.0, 2.0]), pairs.plane_b)
    kept = [rng.permutation(np.flatnonzero(pairs.views == v))[: 400 if v == view else 40] for v in range(4)]
    crowd = Pairs(pairs.views, pairs.plane_a, shifted).take(np.concatenate(kept))
    assert 2 * np.sum(crowd.views == view) > len(crowd)
    T = estimate_motion(spoiled(crowd, ryu, rng, 0.1, 0.3), ryu)
    assert_motion(T, MOTION, degrees=0.3, direction=5.0)
