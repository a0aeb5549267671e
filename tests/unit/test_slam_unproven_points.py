"""Points that tracking has never found again: dropped once their keyframes are left behind."""

from __future__ import annotations

import numpy as np
import pytest
from slam_worlds import folded, mapped, winding_path

from facetcam.slam.camera.optics import Optics
from facetcam.slam.map.map import Map


@pytest.fixture
def world() -> Map:
    optics = Optics(folded(), 8.0)
    return mapped(folded(), optics, winding_path(6, 4.0), np.random.default_rng(5), 0.0)


def test_what_was_found_again_or_is_in_sight_stays(world: Map) -> None:
    left, kept = world.keyframes[:3], world.keyframes[3:]
    before, in_sight = world.observed_points(left), world.observed_points(kept)
    alone = np.setdiff1d(before, in_sight)
    assert len(alone) > 20
    assert len(alone) < len(before)
    world.points.found[alone[::2]] = 1
    world.drop_unproven(left, kept)
    np.testing.assert_array_equal(world.observed_points(kept), in_sight)
    np.testing.assert_array_equal(np.setdiff1d(world.observed_points(left), in_sight), alone[::2])


def test_keyframes_that_nobody_left_lose_nothing(world: Map) -> None:
    before = world.observed_points(world.keyframes)
    world.drop_unproven([], world.keyframes)
    np.testing.assert_array_equal(world.observed_points(world.keyframes), before)
