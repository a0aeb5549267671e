"""Views that lie: each counts once, however many corners it has."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from slam_worlds import by_wheels, distinct_corners, folded, spoiled, true_pairs

from facetcam.geometry import se3
from facetcam.slam.camera.frame import Corners
from facetcam.slam.camera.optics import Optics
from facetcam.slam.relative_pose.confirmed_motion import confirmed_motion
from facetcam.slam.relative_pose.doubt import is_denied, refuting_motion, views_aside
from facetcam.slam.relative_pose.pairs import Pairs, in_sight
from facetcam.slam.relative_pose.two_frames import estimate_motion

Array = NDArray[np.float64]

MOTION = se3.exp([0.0, 0.0, 0.12, 0.05, 0.3, 0.0])
ANOTHER = MOTION @ se3.exp([0.0, 0.0, -0.3, 0.3, -0.2, 0.0])
STRAIGHT = se3.exp([0.0, 0.0, 0.0, 0.0, 0.03, 0.0])


@pytest.fixture(scope="module")
def ryu() -> Optics:
    return Optics(folded(), 8.0)


def joined(*parts: Pairs) -> Pairs:
    return Pairs(*(np.concatenate([getattr(p, n) for p in parts]) for n in ("views", "plane_a", "plane_b")))


def only(pairs: Pairs, views: list[int]) -> Pairs:
    return pairs.without(np.setdiff1d(np.arange(4), views))


def thinned(pairs: Pairs, step: int) -> Pairs:
    return Pairs(pairs.views[::step], pairs.plane_a[::step], pairs.plane_b[::step])


def world(optics: Optics, liars: list[int], seed: int) -> Pairs:
    """Noisy pairs of a motion, with views full of what moves by itself."""
    rng = np.random.default_rng([61, seed])
    true, lie = (spoiled(true_pairs(optics, T, rng), optics, rng, 0.05, 0.3) for T in (MOTION, ANOTHER))
    return joined(true.without(np.array(liars)), only(lie, liars))


@pytest.mark.parametrize("view", range(4))
def test_a_motion_that_one_view_tells_is_denied_by_the_others(ryu: Optics, view: int) -> None:
    pairs = world(ryu, [view], view)
    assert is_denied(pairs, ANOTHER, ryu)
    assert not is_denied(pairs, MOTION, ryu)


def test_views_whose_pairs_are_chance_deny_nothing(ryu: Optics) -> None:
    rng = np.random.default_rng(62)
    pairs = true_pairs(ryu, MOTION, rng)
    chance = only(spoiled(pairs, ryu, rng, 1.0, 0.3), [0, 1, 2])
    assert not is_denied(joined(only(pairs, [3]), chance), MOTION, ryu)


def stretched(T: Array, factor: float) -> Array:
    return se3.from_rotation_translation(T[:3, :3], factor * T[:3, 3])


def test_a_motion_of_another_length_is_not_denied(ryu: Optics) -> None:
    """A young map may yet have the length of a way wrong; where it went, it knows."""
    pairs = true_pairs(ryu, MOTION, np.random.default_rng(66))
    nearly = MOTION @ se3.exp([0.0, 0.0, 0.02, 0.0, 0.0, 0.0])
    for stretch in (0.7, 1.4):
        assert not is_denied(pairs, stretched(nearly, stretch), ryu)
    assert is_denied(pairs, nearly @ se3.exp([0.0, 0.0, 0.0, 0.2, 0.0, 0.0]), ryu)
    assert is_denied(pairs, stretched(MOTION, -1.0), ryu)


@pytest.mark.parametrize("axis", range(3))
def test_a_turn_astray_is_refuted_by_the_motion_that_the_corners_show(ryu: Optics, axis: int) -> None:
    rng = np.random.default_rng([67, axis])
    pairs = spoiled(true_pairs(ryu, MOTION, rng), ryu, rng, 0.2, 0.3)
    astray = MOTION @ se3.exp(0.03 * np.eye(6)[axis])
    found = refuting_motion(pairs, astray, ryu)
    assert found is not None
    assert np.linalg.norm(se3.log(se3.inverse(found) @ MOTION)[:3]) < 0.003
    assert refuting_motion(pairs, MOTION, ryu) is None


def test_a_pattern_that_repeats_refutes_nothing(ryu: Optics) -> None:
    """Windows and tiles look alike a pane further: their pairs agree on another turn in every view."""
    pairs = true_pairs(ryu, MOTION @ se3.exp([0.0, 0.0, 0.15, 0.16, 0.0, 0.0]), np.random.default_rng(69))
    assert refuting_motion(pairs, MOTION, ryu) is None


@pytest.mark.parametrize("view", range(1, 4))
def test_three_views_refute_what_people_in_the_fourth_have_led_far_astray(ryu: Optics, view: int) -> None:
    pairs = world(ryu, [view], 8)
    assert np.linalg.norm(se3.log(se3.inverse(MOTION) @ ANOTHER)[:3]) > 0.1
    found = refuting_motion(pairs, ANOTHER, ryu)
    assert found is not None
    assert np.linalg.norm(se3.log(se3.inverse(found) @ MOTION)[:3]) < 0.003
    two = only(pairs, [view, *({0, 1, 2, 3} - {view})][:3])
    assert refuting_motion(two, ANOTHER, ryu) is None  # a pattern may fool two


@pytest.mark.parametrize("seed", range(3))
def test_three_views_deny_a_motion_though_a_third_of_their_pairs_are_false(ryu: Optics, seed: int) -> None:
    rng = np.random.default_rng([63, seed])
    true, lie = (true_pairs(ryu, T, rng) for T in (MOTION, ANOTHER))
    pairs = joined(spoiled(true.without(np.array([1])), ryu, rng, 0.33, 0.3), only(lie, [1]))
    assert is_denied(pairs, ANOTHER, ryu)
    assert not is_denied(pairs, MOTION, ryu)


def test_neither_a_view_that_lies_nor_chance_refutes(ryu: Optics) -> None:
    assert refuting_motion(world(ryu, [1], 7), MOTION, ryu) is None
    rng = np.random.default_rng(68)
    noise = spoiled(true_pairs(ryu, MOTION, rng), ryu, rng, 0.95, 0.3)
    assert refuting_motion(noise, MOTION, ryu) is None
    assert refuting_motion(Pairs.none(), MOTION, ryu) is None


def test_one_view_against_one_denies_nothing(ryu: Optics) -> None:
    assert not is_denied(only(world(ryu, [1], 5), [0, 1]), ANOTHER, ryu)


def test_wheels_break_the_tie_of_two_views(ryu: Optics) -> None:
    """A person fills one view, and the map has followed him: the other view and the wheels say so."""
    pairs, wheels = only(world(ryu, [1], 5), [0, 1]), MOTION @ se3.exp([0.0, 0.0, 0.01, 0.0, 0.01, 0.0])
    assert is_denied(pairs, ANOTHER, ryu, wheels)
    assert not is_denied(pairs, MOTION, ryu, wheels)
    assert not is_denied(pairs, ANOTHER, ryu, ANOTHER)  # wheels that went the same way are none against it


@pytest.mark.parametrize("view", range(4))
def test_wheels_that_tell_nonsense_silence_no_views(ryu: Optics, view: int) -> None:
    """Three views deny the motion that one tells, be it clearly or by the half of their pairs."""
    nonsense = se3.exp([0.0, 0.0, -0.5, -0.3, -0.3, 0.0])
    pairs = world(ryu, [view], view)
    assert is_denied(pairs, ANOTHER, ryu, nonsense)
    assert not is_denied(pairs, MOTION, ryu, nonsense)
    # This one fits more than half of the pairs of a view.
    slightly = MOTION @ se3.exp([0.0, 0.0, 0.0, 0.06, 0.0, 0.06])
    assert is_denied(pairs, slightly, ryu, nonsense) == is_denied(pairs, slightly, ryu)


def test_a_view_full_of_pairs_does_not_outvote_two_that_have_few(ryu: Optics) -> None:
    """Wheels that say what a person in one view seems to confirm are not confirmed."""
    pairs = world(ryu, [0], 6)
    few = thinned(only(pairs, [1, 2]), 6)
    many = joined(*4 * [only(pairs, [0])], few)
    assert np.mean(many.fit(ANOTHER, ryu)) > 0.8
    wheels = ANOTHER @ se3.exp([0.0, 0.0, 0.01, 0.0, 0.0, 0.0])
    assert confirmed_motion(many, by_wheels(wheels), ryu) is None


def test_one_view_starts_no_map_where_another_was_followed_just_now(ryu: Optics) -> None:
    alone = only(true_pairs(ryu, MOTION, np.random.default_rng(63)), [0])
    assert estimate_motion(alone, ryu) is not None
    assert estimate_motion(alone, ryu, several=True) is None


def stood(pairs: Pairs, view: int) -> Pairs:
    b = np.where((pairs.views == view)[:, None], pairs.plane_a, pairs.plane_b)
    return Pairs(pairs.views, pairs.plane_a, b)


@pytest.mark.parametrize("view", range(4))
def test_only_what_a_turn_should_have_moved_stands_wrongly(ryu: Optics, view: int) -> None:
    rng = np.random.default_rng([64, view])
    assert views_aside(stood(true_pairs(ryu, MOTION, rng), view), MOTION, ryu).tolist() == [view]
    assert not len(views_aside(stood(true_pairs(ryu, STRAIGHT, rng), view), STRAIGHT, ryu))


@pytest.mark.parametrize("noisy", [[3], [2, 3], [1, 2, 3]])
def test_a_view_of_noise_is_no_liar(ryu: Optics, noisy: list[int]) -> None:
    """Views whose corners are paired by chance, as in the dark or on a rough way, show no other motion."""
    rng = np.random.default_rng([66, len(noisy)])
    noise = spoiled(true_pairs(ryu, MOTION, rng), ryu, rng, 0.8, 0.3)
    true = true_pairs(ryu, MOTION, rng)
    pairs = joined(only(true, [v for v in range(4) if v not in noisy]), only(noise, noisy))
    assert not len(views_aside(pairs, MOTION, ryu))


def corners_of(pairs: Pairs) -> Corners:
    return distinct_corners(pairs.plane_a, pairs.views, pairs.plane_a, np.empty((len(pairs), 32), np.uint8))


def test_a_frozen_view_keeps_no_frame_in_sight(ryu: Optics) -> None:
    """Three views have lost nearly all they showed; the fourth, with most corners, still shows it all."""
    pairs = true_pairs(ryu, MOTION, np.random.default_rng(65))
    full = joined(*5 * [only(pairs, [2])], pairs.without(np.array([2])))
    frozen = joined(*5 * [only(pairs, [2])], thinned(pairs.without(np.array([2])), 20))
    assert len(frozen) > 0.5 * len(full)
    assert in_sight(corners_of(full), full)
    assert not in_sight(corners_of(full), frozen)
