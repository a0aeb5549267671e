"""How large patches are foretold: points that an adjustment moves are seen from nearer, or from farther."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from slam_worlds import folded, mapped, winding_path

from facetcam.geometry import se3
from facetcam.slam.adjustment.adjuster import Adjuster
from facetcam.slam.camera.optics import Optics
from facetcam.slam.config import SlamConfig
from facetcam.slam.map.map import Map
from facetcam.slam.map.points import tangents

Array = NDArray[np.float64]

OPTICS = Optics(folded(), 8.0)


@pytest.fixture
def world() -> Map:
    return mapped(folded(), OPTICS, winding_path(12, 1.5), np.random.default_rng(3), 0.05)


def steps_of_a_pixel(world: Map) -> Array:
    """Tangents (N, 3, 2) of all points before the keyframes that see them first; zero where none does."""
    steps = np.zeros((len(world.points), 3, 2))
    for keyframe in reversed(world.keyframes):
        seen, T = keyframe.observations, keyframe.T_world_rig
        points_rig = se3.transform(se3.inverse(T), world.points.xyz[seen.point])
        steps[seen.point] = T[:3, :3] @ tangents(points_rig, seen.view, OPTICS)
    return steps


def believe(world: Map, xyz: Array) -> None:
    """Put the points elsewhere, and take their patches to be as large as they are seen there."""
    world.points.xyz[:] = xyz
    world.points.tangent[:] = steps_of_a_pixel(world)


def sizes_after(world: Map) -> tuple[Array, Array]:
    """How large patches are taken to be (N,), before and after an adjustment, by how large they are then."""
    before = world.points.tangent.copy()
    Adjuster(world, OPTICS, SlamConfig()).adjust_all(last=True)
    length, taken, after = (
        np.linalg.norm(steps, axis=1).mean(axis=1)
        for steps in (steps_of_a_pixel(world), before, world.points.tangent)
    )
    seen = length > 0
    return taken[seen] / length[seen], after[seen] / length[seen]


@pytest.mark.parametrize("factor", [0.5, 2.0, 3.0])
def test_a_world_that_shrinks_or_grows_keeps_its_looks(world: Map, factor: float) -> None:
    for keyframe in world.keyframes:
        keyframe.T_world_rig[:3, 3] *= factor
    believe(world, factor * world.points.xyz)
    before, after = sizes_after(world)
    assert np.median(before) == pytest.approx(factor, rel=0.1)
    np.testing.assert_allclose(np.median(after), 1.0, rtol=0.01)
    assert np.mean(np.abs(after - 1.0) < 0.05) > 0.9


def test_points_of_a_wrong_depth_do_too(world: Map) -> None:
    rng = np.random.default_rng(4)
    home = np.zeros((len(world.points), 3))
    for keyframe in reversed(world.keyframes):
        seen = keyframe.observations
        home[seen.point] = se3.transform(keyframe.T_world_rig, OPTICS.origins(seen.view))
    stretch = np.exp(rng.normal(0.0, 0.3, (len(home), 1)))
    believe(world, home + stretch * (world.points.xyz - home))
    before, after = sizes_after(world)
    assert np.mean(np.abs(before - 1.0) < 0.1) < 0.5
    assert np.mean(np.abs(after - 1.0) < 0.1) > 0.9
