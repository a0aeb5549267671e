"""Two maps made one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from facetcam.features.descriptors import DESCRIPTOR_BYTES
from facetcam.geometry import se3
from facetcam.slam.camera.frame import Corners
from facetcam.slam.map.joining import Similarity, move_world, take_in
from facetcam.slam.map.map import HandedOver, Keyframe, Map
from facetcam.slam.map.measure import Measurements
from facetcam.slam.map.places import Places, Sightings
from facetcam.slam.map.trajectory import Trajectory

Array = NDArray[np.float64]

twists = st.lists(st.floats(-2.0, 2.0), min_size=6, max_size=6).map(se3.exp)
growths = st.floats(0.1, 10.0)


@given(twists, twists, twists, growths)
def test_a_rig_sees_the_same_from_its_pose_in_either_world(
    T_there: Array, T_here: Array, T_later: Array, growth: float
) -> None:
    """What the rig sees is alike but for the size, at the pose that told the similarity and at others."""
    into = Similarity.between(T_there, T_here, growth)
    np.testing.assert_allclose(into.pose(T_here), T_there, atol=1e-9)
    xyz = np.random.default_rng(1).standard_normal((5, 3))
    before = se3.transform(se3.inverse(T_later), xyz)
    after = se3.transform(se3.inverse(into.pose(T_later)), into.points(xyz))
    np.testing.assert_allclose(after, growth * before, atol=1e-8)
    step = np.random.default_rng(2).standard_normal((5, 3, 2))
    moved = into.points(xyz + step[:, :, 0]) - into.points(xyz)
    np.testing.assert_allclose(into.steps(step)[:, :, 0], moved, atol=1e-8)


def made(rng: np.random.Generator, n_points: int, n_keyframes: int) -> tuple[Map, Places, Trajectory]:
    """A map whose keyframes see random points, with its index and a frame hung on each keyframe."""
    map, places, trajectory = Map(), Places(), Trajectory()
    map.points.extend(
        xyz=rng.standard_normal((n_points, 3)),
        descriptor=rng.integers(0, 256, (n_points, DESCRIPTOR_BYTES), dtype=np.uint8),
    )
    map.points.alive[::7] = False
    for k in range(n_keyframes):
        keyframe = Keyframe(k, float(k), se3.exp(rng.standard_normal(6)), Corners.none(), None, np.zeros(3))
        ids = np.sort(rng.choice(n_points, 8, replace=False))
        views = np.zeros(8, np.int8)
        keyframe.observations.append(ids, views, rng.random((8, 2)), rng.random((8, 2)))
        keyframe.handovers = HandedOver(ids[:3], views[:3], views[:3] + 1, rng.random((3, 2)))
        map.keyframes.append(keyframe)
        places.restore(Sightings(ids, np.full(8, k), map.points.descriptor[ids]), k + 1)
        seen = Measurements(ids, views, rng.random((8, 2)), rng.random((8, 2)))
        trajectory.add(float(k), keyframe.T_world_rig @ se3.exp(0.1 * rng.standard_normal(6)), keyframe, seen)
    return map, places, trajectory


def sighted(map: Map) -> list[list[Array]]:
    """Places of the points that each keyframe has seen, and of those handed over to it."""
    xyz = map.points.xyz
    return [[xyz[k.observations.point].copy(), xyz[k.handovers.point].copy()] for k in map.keyframes]


def test_all_that_two_maps_know_is_in_the_joined_one() -> None:
    rng = np.random.default_rng(7)
    (old, old_places, old_way), (new, places, way) = made(rng, 40, 5), made(rng, 1500, 6)
    new.number, was = 3, sighted(old) + sighted(new)
    alive = np.concatenate([new.points.alive, old.points.alive])
    times, poses = (np.concatenate(pair) for pair in zip(old_way.poses(), way.poses()))
    n_old, looks = len(old.points), np.concatenate([new.points.descriptor, old.points.descriptor])
    ahead = take_in(new, places, old, old_places)
    way.join(old_way, ahead)
    assert (ahead, len(new.points), new.number) == (1500, 1500 + n_old, 0)
    assert [k.index for k in new.keyframes] == list(range(11))
    for before, after in zip(was, sighted(new)):
        for a, b in zip(before, after):
            np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(new.points.alive, alive)
    assert new.keyframes[4].odometry is not None and new.keyframes[5].odometry is None
    assert new.since == 5
    known = places.sightings
    assert places.indexed == 11
    np.testing.assert_array_equal(known.descriptor, looks[known.point])
    for k, keyframe in enumerate(new.keyframes):
        assert set(places.of_keyframes(np.array([k])).point) == set(keyframe.observations.point)
    order = np.argsort(times, kind="stable")
    np.testing.assert_array_equal(way.poses()[0], times[order])
    np.testing.assert_allclose(way.poses()[1], poses[order], atol=1e-12)


def test_frames_of_a_joined_map_keep_what_they_saw() -> None:
    """Their poses are solved again from the points that they saw, under the ids of the joined map."""
    rng = np.random.default_rng(8)
    (_, _, old_way), (_, _, way) = made(rng, 40, 2), made(rng, 60, 2)
    seen = [frame.seen.point.copy() for frame in old_way._frames if frame.seen is not None]
    way.join(old_way, 60)
    joined = [f.seen.point for f in way._frames if f.seen is not None and f.seen.point.min() >= 60]
    assert len(joined) == 2
    np.testing.assert_array_equal(np.stack(joined), np.stack(seen) + 60)


def test_a_map_that_moves_takes_all_with_it() -> None:
    rng = np.random.default_rng(9)
    map, _, way = made(rng, 50, 4)
    map.points.tangent[:] = rng.standard_normal((50, 3, 2))
    into = Similarity(se3.exp(rng.standard_normal(6)), 1.7)
    xyz, poses = map.points.xyz.copy(), way.poses()[1]
    local = [se3.transform(se3.inverse(k.T_world_rig), xyz[k.observations.point]) for k in map.keyframes]
    move_world(map, into)
    for keyframe, before in zip(map.keyframes, local):
        after = se3.transform(se3.inverse(keyframe.T_world_rig), map.points.xyz[keyframe.observations.point])
        np.testing.assert_allclose(after, 1.7 * before, atol=1e-9)
        assert keyframe.scale == pytest.approx(1.7)
    expected = np.stack([into.pose(T) for T in poses])
    np.testing.assert_allclose(way.poses()[1], expected, atol=1e-9)  # frames hang on their keyframes


def test_what_is_moved_out_leaves_nothing() -> None:
    map, places, way = made(np.random.default_rng(10), 30, 3)
    map.creep, map.readout = np.array([0.1, 0.2]), 0.01
    other, index, frames = map.moved_out(), places.moved_out(), way.moved_out()
    assert (len(other.keyframes), len(other.points), index.indexed, len(frames)) == (3, 30, 3, 3)
    assert (other.readout, other.creep.tolist()) == (0.01, [0.1, 0.2])
    assert (len(map.keyframes), len(map.points), places.indexed, len(way)) == (0, 0, 0, 0)
    assert len(places.sightings) == 0 and map.readout == 0.0
