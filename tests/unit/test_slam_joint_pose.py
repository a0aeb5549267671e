"""Poses that few points of the map hold, put right by corners that have no place in it yet."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from slam_worlds import folded, in_sight, look, pyramid, spoiled, true_pairs

from facetcam.geometry import se3
from facetcam.slam.config import SlamConfig
from facetcam.slam.joint_pose import joint_pose
from facetcam.slam.measure import Measurements
from facetcam.slam.optics import Optics
from facetcam.slam.pairs import Pairs
from facetcam.slam.pose import refine_pose

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
    T = joint_pose(LAST, wrong, seen, bent, pairs, optics, CONFIG)
    alone = errors(
        refine_pose(wrong, bent, seen.view, seen.plane, optics, CONFIG.pixel_sigma).T_world_rig, true
    )
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
    every = Pairs(
        *(np.concatenate(c) for c in zip(*((p.views, p.plane_a, p.plane_b) for p in (pairs, lying))))
    )
    before = errors(refine_pose(true, xyz, seen.view, plane, optics, CONFIG.pixel_sigma).T_world_rig, true)
    after = errors(joint_pose(LAST, true @ ASTRAY, seen, xyz, every, optics, CONFIG), true)
    assert after[0] < before[0] + 0.03
    assert after[1] < before[1] + 0.15


@pytest.mark.parametrize("name", EYES)
def test_without_corners_it_is_the_pose_of_the_points(name: str) -> None:
    optics, rng, true = EYES[name], np.random.default_rng(3), LAST @ MOTION
    points = in_sight(optics, true[None], rng, 300)
    sight = look(optics, true, points)
    seen = Measurements(sight.point, sight.view, sight.pixels, sight.plane)
    T = joint_pose(LAST, true @ ASTRAY, seen, points[sight.point], Pairs.none(), optics, CONFIG)
    turn, way = errors(T, true)
    assert turn < 0.02
    assert way < 0.1
