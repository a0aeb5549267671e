"""Two frames: epipolar errors against OpenCV, motion and its refusal against known motions."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from slam_worlds import (
    assert_motion,
    by_wheels,
    distinct_corners,
    folded,
    in_sight,
    look,
    pyramid,
    single,
    spoiled,
    true_pairs,
)

from facetcam.features.matching import hamming, mutual_best
from facetcam.geometry import se3
from facetcam.slam.camera.optics import Optics
from facetcam.slam.config import SlamConfig
from facetcam.slam.relative_pose.confirmed_motion import confirmed_motion, enough_parallax
from facetcam.slam.relative_pose.degenerate import standing_views
from facetcam.slam.relative_pose.epipolar import epipolar_error, match_along_epipolars
from facetcam.slam.relative_pose.pairs import Pairs
from facetcam.slam.relative_pose.two_frames import MIN_MATCHES, estimate_motion

Array = NDArray[np.float64]

MOTION = se3.exp([0.02, -0.03, 0.12, 0.08, 0.3, 0.03])


@pytest.fixture(scope="module")
def ryu() -> Optics:
    return Optics(folded(), 8.0)


def test_matches_along_epipolars_are_those_of_all_pairs(ryu: Optics) -> None:
    rng, config = np.random.default_rng(22), SlamConfig()
    pairs = true_pairs(ryu, MOTION, rng, 1500)
    looks = np.repeat(rng.integers(0, 256, (len(pairs) // 2 + 1, 32), np.uint8), 2, axis=0)[: len(pairs)]
    noise = rng.choice(np.array([0, 0, 1, 16, 64], np.uint8), (2, *looks.shape))  # everything has a double
    planes = (pairs.plane_a, pairs.plane_b)
    a, b = (distinct_corners(plane, pairs.views, plane, looks ^ n) for plane, n in zip(planes, noise))
    expected = []
    for view in range(ryu.n_views):
        own = np.flatnonzero(pairs.views == view)
        distance = hamming(a.descriptors[own], b.descriptors[own])
        errors = epipolar_error(a.plane[own][:, None], b.plane[own][None], view, MOTION, ryu)
        distance[np.abs(errors) > 2.0] = 10000
        limits = (config.match_ratio, config.match_distance)
        forth = zip(*mutual_best(distance, *limits))
        back = {(row, column) for column, row in zip(*mutual_best(distance.T, *limits))}
        expected += [(own[row], own[column]) for row, column in forth if (row, column) in back]
    every = np.arange(len(pairs))
    found = match_along_epipolars(a, every, b, every, MOTION, 2.0, ryu, config)
    assert list(zip(*found)) == expected
    assert 100 < len(expected) < len(pairs)
    some = every[rng.random(len(every)) < 0.6]  # the others are taken, and yet look as these do
    taken = match_along_epipolars(a, some, b, every, MOTION, 2.0, ryu, config)
    assert list(zip(*taken)) == [pair for pair in expected if pair[0] in set(some)]


def test_epipolar_error_is_opencvs_sampson_distance(ryu: Optics) -> None:
    rng = np.random.default_rng(21)
    for view in range(ryu.n_views):
        a, b = rng.uniform(-200, 200, (2, 30, 2))
        T_b_a = ryu.T_view_rig[view] @ se3.inverse(MOTION) @ ryu.T_rig_view[view]
        E = se3.skew(T_b_a[:3, 3]) @ T_b_a[:3, :3]
        K_inverse = np.diag([1 / ryu.focal, 1 / ryu.focal, 1.0])
        F = K_inverse.T @ E @ K_inverse
        homogeneous = (np.column_stack([p, np.ones(len(p))]) for p in (a, b))
        squared = [cv2.sampsonDistance(p, q, F) for p, q in zip(*homogeneous)]
        np.testing.assert_allclose(epipolar_error(a, b, view, MOTION, ryu) ** 2, squared, rtol=1e-6)


def test_true_pairs_lie_on_their_epipolars_in_mirror_images_too(ryu: Optics) -> None:
    for optics in (ryu, Optics(pyramid(), 8.0)):
        pairs = true_pairs(optics, MOTION, np.random.default_rng(22))
        assert len(np.unique(pairs.views)) == optics.n_views
        assert np.abs(pairs.epipolar_errors(MOTION, optics)).max() < 1e-3
        wrong = MOTION @ se3.exp([0.0, 0.0, 0.05, 0.0, 0.0, 0.0])
        assert np.median(np.abs(pairs.epipolar_errors(wrong, optics))) > 1.0


def test_parallax_is_the_angle_between_true_rays(ryu: Optics) -> None:
    point = in_sight(ryu, np.eye(4)[None], np.random.default_rng(23), 400)
    a, b = look(ryu, np.eye(4), point), look(ryu, MOTION, point)
    _, rows_a, rows_b = np.intersect1d(128 * a.point + a.view, 128 * b.point + b.view, return_indices=True)
    pairs = Pairs(a.view[rows_a], a.plane[rows_a], b.plane[rows_b])
    distance, angle = pairs.parallax(MOTION, ryu)
    true = point[a.point[rows_a]]
    from_a = true - ryu.origins(pairs.views)
    from_b = true - se3.transform(MOTION, ryu.origins(pairs.views))
    cosine = np.einsum("ij,ij->i", from_a, from_b)
    expected = np.arccos(cosine / np.linalg.norm(from_a, axis=1) / np.linalg.norm(from_b, axis=1))
    np.testing.assert_allclose(angle, expected, atol=1e-5)
    np.testing.assert_allclose(distance, np.linalg.norm(from_a, axis=1), rtol=1e-3)


def test_a_turn_on_the_spot_leaves_nothing_to_translation() -> None:
    optics = Optics(single(), 8.0)
    rng = np.random.default_rng(24)
    turned = true_pairs(optics, se3.exp([0.05, 0.1, -0.15, 0, 0, 0]), rng)
    assert turned.pure_rotation(optics)[1].max() < 1e-6
    moved = true_pairs(optics, MOTION, rng)
    assert np.median(moved.pure_rotation(optics)[1]) > 0.01


@pytest.mark.parametrize("seed", range(3))
def test_motion_is_found_through_wrong_pairs(ryu: Optics, seed: int) -> None:
    rng = np.random.default_rng([25, seed])
    pairs = spoiled(true_pairs(ryu, MOTION, rng), ryu, rng, 0.15, 0.3)
    T = estimate_motion(pairs, ryu)
    assert_motion(T, MOTION, degrees=0.1, direction=2.0)
    assert T is not None
    assert np.linalg.norm(T[:3, 3]) == pytest.approx(np.linalg.norm(MOTION[:3, 3]), rel=0.5)


def test_motion_is_found_behind_mirror_images() -> None:
    optics, rng = Optics(pyramid(), 8.0), np.random.default_rng(26)
    pairs = spoiled(true_pairs(optics, MOTION, rng), optics, rng, 0.1, 0.3)
    assert_motion(estimate_motion(pairs, optics), MOTION, degrees=0.1, direction=2.0)


@pytest.mark.parametrize("seed", range(4))
def test_few_pairs_in_each_view_tell_a_motion_together(seed: int) -> None:
    """Forty in each of three views, a fifth of them wrong."""
    optics, rng = Optics(pyramid(), 8.0), np.random.default_rng([33, seed])
    pairs = true_pairs(optics, MOTION, rng)
    rows = np.concatenate(
        [rng.permutation(np.flatnonzero(pairs.views == v))[:40] for v in range(optics.n_views)]
    )
    few = Pairs(pairs.views[rows], pairs.plane_a[rows], pairs.plane_b[rows])
    assert len(few) == 120
    T = estimate_motion(spoiled(few, optics, rng, 0.2, 0.2), optics)
    assert_motion(T, MOTION, degrees=0.3, direction=3.0)


@pytest.mark.parametrize("seed", range(4))
def test_wheels_are_turned_as_the_images_say_however_the_floor_tilts_the_rig(ryu: Optics, seed: int) -> None:
    """A ramp pitches the rig by five degrees, of which wheels know nothing."""
    rng = np.random.default_rng([34, seed])
    level = se3.exp([0.0, 0.0, 0.03, 0.0, 0.3, 0.0])
    tilted = level @ se3.exp([0.085, 0.02, 0.0, 0.0, 0.0, 0.0])
    pairs = true_pairs(ryu, tilted, rng)
    rows = rng.permutation(len(pairs))[:120]
    few = Pairs(pairs.views[rows], pairs.plane_a[rows], pairs.plane_b[rows])
    T = confirmed_motion(spoiled(few, ryu, rng, 0.2, 0.3), by_wheels(level), ryu)
    assert_motion(T, tilted, degrees=0.4, direction=5.0)


def test_wheels_and_images_that_go_different_ways_deny_each_other(ryu: Optics) -> None:
    rng = np.random.default_rng(35)
    pairs = spoiled(true_pairs(ryu, se3.exp([0.0, 0.0, 0.0, 0.3, 0.1, 0.0]), rng), ryu, rng, 0.1, 0.3)
    assert confirmed_motion(pairs, by_wheels(se3.exp([0.0, 0.0, 0.0, 0.0, 0.3, 0.0])), ryu) is None


def test_two_views_that_stand_against_two_that_move_leave_the_images_undecided(ryu: Optics) -> None:
    """Frozen images, or a rig at rest with people before two views: wheels know, the images do not."""
    rng = np.random.default_rng(36)
    pairs = spoiled(true_pairs(ryu, MOTION, rng), ryu, rng, 0.1, 0.3)
    still = (pairs.views < 2)[:, None]
    frozen = Pairs(pairs.views, pairs.plane_a, np.where(still, pairs.plane_a, pairs.plane_b))
    assert standing_views(frozen).tolist() == [0, 1]
    assert estimate_motion(frozen, ryu) is None
    T = confirmed_motion(frozen, by_wheels(MOTION @ se3.exp([0.03, 0.0, 0.02, 0.0, 0.0, 0.0])), ryu)
    assert_motion(T, MOTION, degrees=0.3, direction=6.0)


def test_motion_of_one_camera_has_a_direction() -> None:
    optics, rng = Optics(single(), 8.0), np.random.default_rng(27)
    pairs = spoiled(true_pairs(optics, MOTION, rng), optics, rng, 0.15, 0.3)
    assert_motion(estimate_motion(pairs, optics), MOTION, degrees=0.1, direction=2.0)


@pytest.mark.parametrize(
    "twist", [np.zeros(6), np.array([0.02, 0.01, 0.2, 0, 0, 0]), np.array([0, 0, 0.01, 0, 0.002, 0])]
)
def test_no_motion_is_invented(ryu: Optics, twist: Array) -> None:
    """A stand, a turn on the spot about the rig's axis, and a step too small to see."""
    rng = np.random.default_rng(28)
    pairs = spoiled(true_pairs(ryu, se3.exp(twist), rng), ryu, rng, 0.1, 0.3)
    assert len(pairs) > 5 * MIN_MATCHES
    assert estimate_motion(pairs, ryu) is None


def test_pairs_that_agree_on_nothing_give_no_motion(ryu: Optics) -> None:
    rng = np.random.default_rng(29)
    pairs = true_pairs(ryu, MOTION, rng)
    assert estimate_motion(spoiled(pairs, ryu, rng, 1.0, 0.3), ryu) is None


@pytest.mark.parametrize(("nearness", "starts"), [(1.0, True), (0.15, False)])
def test_a_world_of_dwarfs_starts_no_map(ryu: Optics, nearness: float, starts: bool) -> None:
    """Points all around at 12 to 45 cm, and at the usual distances; what is small moves as much by little."""
    rng = np.random.default_rng(31)
    T = se3.exp([0.01, -0.01, 0.03, *(nearness * np.array([0.05, 0.2, 0.02]))])
    rows, columns = np.nonzero(ryu.labels >= 0)
    pick = rng.integers(0, len(rows), 900)
    pixels, views = (
        np.column_stack([columns[pick], rows[pick]]).astype(float),
        ryu.labels[rows[pick], columns[pick]],
    )
    away = nearness * rng.uniform(0.8, 3.0, (900, 1)) * ryu.rays(pixels, views)
    points = ryu.origins(views) + away
    a, b = look(ryu, np.eye(4), points), look(ryu, T, points)
    _, rows_a, rows_b = np.intersect1d(128 * a.point + a.view, 128 * b.point + b.view, return_indices=True)
    pairs = Pairs(a.view[rows_a], a.plane[rows_a], b.plane[rows_b])
    assert len(pairs) > 100
    assert (estimate_motion(pairs, ryu) is not None) == starts


def test_too_few_pairs_give_no_motion(ryu: Optics) -> None:
    pairs = true_pairs(ryu, MOTION, np.random.default_rng(30))
    few = slice(None, None, len(pairs) // MIN_MATCHES + 2)
    few_pairs = Pairs(pairs.views[few], pairs.plane_a[few], pairs.plane_b[few])
    assert estimate_motion(few_pairs, ryu) is None


@pytest.mark.parametrize(("distance", "told"), [(200.0, False), (25.0, True)])
def test_one_view_alone_starts_no_map_where_others_see_the_same_motion(
    ryu: Optics, distance: float, told: bool
) -> None:
    """What is too far away in the other views bears no motion out; where they are dark they are not asked."""
    pairs = true_pairs(ryu, MOTION, np.random.default_rng(31))
    near = pairs.views == np.argmax(np.bincount(pairs.views))
    far = pairs.plane_a.copy()
    for view in np.unique(pairs.views[~near]):
        rows = (pairs.views == view) & ~near
        T_view_new = ryu.T_view_rig[view] @ se3.inverse(MOTION) @ ryu.T_rig_view[view]
        rays = np.column_stack([pairs.plane_a[rows] / ryu.focal, np.ones(rows.sum())])
        moved = se3.transform(T_view_new, distance * rays)
        far[rows] = ryu.focal * moved[:, :2] / moved[:, 2:]
    some = near | (np.arange(len(pairs)) % 3 == 0)
    b = np.where(near[:, None], pairs.plane_b, far)
    one_view = Pairs(pairs.views[some], pairs.plane_a[some], b[some])
    assert np.mean(one_view.pure_rotation(ryu)[1] > 0.01) > 0.4
    assert np.all(one_view.parallax(MOTION, ryu)[1][one_view.views != pairs.views[near][0]] < 0.02)
    assert (estimate_motion(one_view, ryu) is not None) == told
    alone = Pairs(pairs.views[near], pairs.plane_a[near], pairs.plane_b[near])
    assert estimate_motion(alone, ryu) is not None


@pytest.mark.parametrize(
    ("length", "count", "enough"), [(1.0, 34, True), (1.0, 26, False), (0.02, 300, False)]
)
def test_wheels_that_the_images_bear_out_start_a_map_with_as_few_pairs_as_sight(
    ryu: Optics, length: float, count: int, enough: bool
) -> None:
    """Thirty that show parallax; where six small views see a little each, more had taken five seconds."""
    T = se3.exp(length * se3.log(MOTION))
    rng = np.random.default_rng(32)
    pairs = true_pairs(ryu, T, rng)
    telling = pairs.parallax(T, ryu)[1] > 0.03 * length
    every = rng.permutation(np.flatnonzero(telling))[:count]
    looks = rng.integers(0, 256, (count, 32), np.uint8)
    a, b = (
        distinct_corners(p[every], pairs.views[every], p[every], looks)
        for p in (pairs.plane_a, pairs.plane_b)
    )
    assert enough_parallax(a, b, T, ryu, SlamConfig(), np.empty(0, np.int64), several=True) == enough
