"""Poses that few points of the map hold, put right by corners that have no place in it yet."""

from __future__ import annotations

from typing import cast

import numpy as np
import pytest
from numpy.typing import NDArray
from slam_worlds import distinct_corners, folded, in_sight, look, pyramid, spoiled, true_pairs

from facetcam.geometry import se3
from facetcam.slam.adjustment.adjuster import Adjuster
from facetcam.slam.camera.frame import Corners, Frame
from facetcam.slam.camera.optics import Optics
from facetcam.slam.camera.pose import refine_pose
from facetcam.slam.camera.sight import Sights
from facetcam.slam.config import SlamConfig
from facetcam.slam.map.map import Keyframe, Map
from facetcam.slam.map.measure import Measurements, Predictions
from facetcam.slam.mapping.mapper import Mapper
from facetcam.slam.relative_pose.doubt import views_aside
from facetcam.slam.relative_pose.pairs import Pairs
from facetcam.slam.tracking.joint_pose import JointSight
from facetcam.slam.tracking.relocaliser import Relocaliser
from facetcam.slam.tracking.tracker import Tracker

Array = NDArray[np.float64]

LAST = se3.exp([0.02, -0.01, 0.3, 0.5, -0.2, 0.1])
MOTION = se3.exp([0.01, -0.02, 0.1, 0.05, 0.15, 0.01])
ASTRAY = se3.exp([0.002, -0.003, 0.015, 0.09, 0.03, 0.01])  # a degree and a decimetre
CONFIG = SlamConfig()
EYES = {"folded": Optics(folded(), 8.0), "pyramid": Optics(pyramid(), 8.0)}


def few_points(optics: Optics, T: Array, rng: np.random.Generator, count: int) -> tuple[Measurements, Array]:
    """Far points in one view alone, as patches measure them."""
    points = in_sight(optics, T[None], rng, 4000)
    seen = look(optics, T, points)
    away = np.linalg.norm(points[seen.point] - T[:3, 3], axis=1)
    rows = np.flatnonzero((seen.view == 0) & (away > 2.5))[:count]
    xyz = points[seen.point[rows]]
    plane = seen.plane[rows] + rng.normal(0.0, 0.25, (len(rows), 2))
    return Measurements(np.arange(len(rows)), seen.view[rows], seen.pixels[rows], plane), xyz


def together(*parts: Pairs) -> Pairs:
    """All pairs of some."""
    columns = zip(*((p.views, p.plane_a, p.plane_b) for p in parts))
    return Pairs(*(np.concatenate(c) for c in columns))


def doubted(
    optics: Optics, T: Array, seen: Measurements, xyz: Array, pairs: Pairs, rng: np.random.Generator
) -> Keyframe:
    """A keyframe of a map of points `xyz`, after its corners were asked about its pose."""
    looks, world = rng.integers(0, 256, (len(pairs), 32), np.uint8), Map()
    world.points.extend(xyz=xyz)
    for index, (pose, plane) in enumerate(((LAST, pairs.plane_a), (T, pairs.plane_b))):
        corners = distinct_corners(plane, pairs.views, plane, looks)
        world.keyframes.append(Keyframe(index, 0.1 * index, pose, corners, None, None))
    last, keyframe = world.keyframes
    keyframe.observations.append(seen.point, seen.view, seen.pixels, seen.plane)
    keyframe.free = np.ones(len(pairs), dtype=bool)
    mapper = Mapper(world, optics, CONFIG, lambda frame: Corners.none(), Adjuster(world, optics, CONFIG))
    mapper._doubt(keyframe, [last])
    return keyframe


def sight_of(seen: Measurements, xyz: Array, pairs: Pairs, optics: Optics) -> JointSight:
    """Of points that are corners."""
    return JointSight(LAST, Sights.of_corners(xyz, seen.view, seen.plane), pairs, optics, CONFIG)


def errors(T: Array, true: Array) -> tuple[float, float]:
    """Of a pose in degrees and centimetres."""
    turn, way = np.linalg.norm(se3.log(se3.inverse(true) @ T).reshape(2, 3), axis=1)
    return float(np.degrees(turn)), 100.0 * float(way)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", EYES)
def test_corners_of_all_views_put_a_bent_pose_right(name: str, seed: int) -> None:
    """Points of one view, which the map has bent, bear out a pose a degree astray."""
    optics, rng, true = EYES[name], np.random.default_rng(seed), LAST @ MOTION
    wrong = true @ ASTRAY
    seen, xyz = few_points(optics, true, rng, 20)
    bent = se3.transform(wrong @ se3.inverse(true), xyz)
    pairs = spoiled(true_pairs(optics, MOTION, rng, 250), optics, rng, 0.3, 0.5)
    T = sight_of(seen, bent, pairs, optics).refined_pose(wrong)
    sights = Sights.of_corners(bent, seen.view, seen.plane)
    alone = errors(refine_pose(wrong, sights, optics, CONFIG.pixel_sigma).T_world_rig, true)
    turn, way = errors(T, true)
    assert turn < 0.6 * alone[0]
    assert way < 0.7 * alone[1]
    fits, best = (pairs.fit(M, optics).mean() for M in (se3.inverse(LAST) @ T, MOTION))
    assert fits > 0.9 * best


@pytest.mark.parametrize("name", EYES)
def test_many_points_hold_their_pose(name: str) -> None:
    """A view that lies, and corners that are mistaken, move no pose that the map knows well."""
    optics, rng, true = EYES[name], np.random.default_rng(7), LAST @ MOTION
    points = in_sight(optics, true[None], rng, 600)
    sight = look(optics, true, points)
    plane = sight.plane + rng.normal(0.0, 0.25, sight.plane.shape)
    seen = Measurements(sight.point, sight.view, sight.pixels, plane)
    xyz = points[sight.point]
    pairs = spoiled(true_pairs(optics, MOTION, rng, 400), optics, rng, 0.3, 0.5)
    lying = true_pairs(optics, MOTION @ se3.exp([0, 0, 0.03, 0.1, 0, 0]), rng, 400)
    lying = lying.take(lying.views == 1)
    every = together(pairs, lying)
    sights = Sights.of_corners(xyz, seen.view, plane)
    before = errors(refine_pose(true, sights, optics, CONFIG.pixel_sigma).T_world_rig, true)
    after = errors(sight_of(seen, xyz, every, optics).refined_pose(true @ ASTRAY), true)
    assert after[0] < before[0] + 0.03
    assert after[1] < before[1] + 0.15


@pytest.mark.parametrize("name", EYES)
def test_without_corners_it_is_the_pose_of_the_points(name: str) -> None:
    optics, rng, true = EYES[name], np.random.default_rng(3), LAST @ MOTION
    points = in_sight(optics, true[None], rng, 300)
    sight = look(optics, true, points)
    seen = Measurements(sight.point, sight.view, sight.pixels, sight.plane)
    T = sight_of(seen, points[sight.point], Pairs.none(), optics).refined_pose(true @ ASTRAY)
    turn, way = errors(T, true)
    assert turn < 0.02
    assert way < 0.1


def test_a_view_that_contradicts_a_bent_pose_is_believed() -> None:
    """The keyframe goes over to the pose that points and corners share, and the view gives points."""
    optics, rng, true = EYES["folded"], np.random.default_rng(5), LAST @ MOTION
    wrong = true @ ASTRAY
    seen, xyz = few_points(optics, true, rng, 20)
    pairs = spoiled(true_pairs(optics, MOTION, rng, 400), optics, rng, 0.1, 0.3)
    bent = se3.transform(wrong @ se3.inverse(true), xyz)
    assert len(views_aside(pairs, se3.inverse(LAST) @ wrong, optics))
    keyframe = doubted(optics, wrong, seen, bent, pairs, rng)
    assert errors(keyframe.T_world_rig, true)[0] < 0.6 * errors(wrong, true)[0]
    assert keyframe.free.all()


def test_a_view_that_lies_moves_no_keyframe() -> None:
    """Images of another way, as people show them, are set aside where many points hold the pose."""
    optics, rng, true = EYES["folded"], np.random.default_rng(6), LAST @ MOTION
    points = in_sight(optics, true[None], rng, 600)
    sight = look(optics, true, points)
    pairs = true_pairs(optics, MOTION, rng, 400)
    lying = true_pairs(optics, MOTION @ se3.exp([0, 0, 0.06, 0.2, 0, 0]), rng, 400)
    honest, lying = pairs.take(pairs.views != 1), lying.take(lying.views == 1)
    every = together(honest, lying)
    seen = Measurements(sight.point, sight.view, sight.pixels, sight.plane)
    keyframe = doubted(optics, true, seen, points, every, rng)
    assert errors(keyframe.T_world_rig, true)[0] < 0.02
    np.testing.assert_array_equal(keyframe.free, every.views != 1)


def test_one_view_alone_wins_no_pose() -> None:
    """Where few points hold a pose, a view full of people must not draw it along."""
    optics, rng, true = EYES["folded"], np.random.default_rng(6), LAST @ MOTION
    seen, xyz = few_points(optics, true, rng, 20)
    pairs = true_pairs(optics, MOTION, rng, 200)
    lying = true_pairs(optics, MOTION @ ASTRAY @ ASTRAY, rng, 800)
    every = together(pairs.take(pairs.views != 1), lying.take(lying.views == 1))
    assert sight_of(seen, xyz, every, optics).agreed_pose(true) is None


def held(count: int, pairs: Pairs, astray: int = 0) -> Array | None:
    """The pose that so many points and the corners hold; some of the points are metres off."""
    optics, rng, true = EYES["folded"], np.random.default_rng(8), LAST @ MOTION
    seen, xyz = few_points(optics, true, rng, count)
    xyz[:astray] += rng.normal(0.0, 2.0, (astray, 3))
    return sight_of(seen, xyz, pairs, optics).held_pose(true @ ASTRAY)


def some_pairs(count: int, wrong: float = 0.0) -> Pairs:
    rng, optics = np.random.default_rng(9), EYES["folded"]
    pairs: Pairs = spoiled(true_pairs(optics, MOTION, rng, 400), optics, rng, wrong, 0.3)
    return pairs.take(np.arange(count))


@pytest.mark.parametrize("astray", [0, 3])
def test_corners_hold_a_pose_with_too_few_points(astray: int) -> None:
    T = held(10, some_pairs(60, 0.1), astray)
    assert T is not None
    turn, way = errors(T, LAST @ MOTION)
    assert turn < 0.2
    assert way < 3.0


@pytest.mark.parametrize(
    ("points", "pairs", "astray"),
    [
        (5, some_pairs(60), 0),
        (10, some_pairs(8), 0),
        (10, some_pairs(60, 0.5), 0),
        (10, some_pairs(60), 7),
        (0, Pairs.none(), 0),
    ],
    ids=["few points", "few corners", "corners that disagree", "points that disagree", "nothing"],
)
def test_nothing_less_holds_it(points: int, pairs: Pairs, astray: int) -> None:
    assert held(points, pairs, astray) is None


@pytest.mark.parametrize(("expected", "found"), [(40, True), (300, False)])
def test_a_pose_that_a_tenth_of_the_map_bears_out_is_held_by_nothing(
    monkeypatch: pytest.MonkeyPatch, expected: int, found: bool
) -> None:
    """By chance some patches of many agree with any pose, and corners may be none."""
    optics, rng, true = EYES["folded"], np.random.default_rng(10), LAST @ MOTION
    seen, xyz = few_points(optics, true, rng, 20)
    world = Map()
    world.keyframes.append(Keyframe(0, 0.0, LAST, Corners.none(), None, None))
    tracker = Tracker(world, optics, CONFIG, lambda frame: Corners.none(), cast(Relocaliser, None))
    rows = np.arange(expected)
    sought = Predictions(rows, rows.astype(np.int8) % 4, np.zeros((expected, 2)), np.zeros((expected, 2, 2)))
    blurred = seen.plane + rng.normal(0.0, 1.2, seen.plane.shape)
    sights = Sights.of_corners(xyz, seen.view, blurred)
    monkeypatch.setattr(tracker, "_sighted", lambda *_: (sought, seen, sights))
    assert (tracker.held(cast(Frame, None), true, np.zeros(6)) is not None) == found
