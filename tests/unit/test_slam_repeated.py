"""What repeats in a view: told by descriptors, and sought only where it was seen before."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from slam_worlds import distinct_corners

from facetcam.slam.camera.frame import Corners, repeated
from facetcam.slam.map.map import Keyframe, Map

KINDS = 12  # of which random descriptors of 256 bits are some 128 bits apart


def corners(kind: NDArray[np.int64], view: NDArray[np.int64], step: float, seed: int) -> Corners:
    """Corners in a row, `step` pixels apart, that look as their kind does, less a few bits."""
    rng = np.random.default_rng(seed)
    looks = rng.integers(0, 256, (KINDS, 32), np.uint8)[kind]
    looks[:, :8] ^= rng.choice(np.array([0, 1, 16], np.uint8), (len(kind), 8))
    pixels = np.column_stack([step * np.arange(len(kind)), np.zeros(len(kind))])
    return distinct_corners(pixels, view.astype(np.int8), pixels, looks)


@settings(max_examples=50, deadline=None)
@given(st.lists(st.tuples(st.integers(0, KINDS - 1), st.integers(0, 2)), min_size=1, max_size=40), st.data())
def test_a_corner_repeats_where_another_one_of_its_kind_is_in_its_view(
    things: list[tuple[int, int]], data: st.DataObject
) -> None:
    kind, view = np.array(things).T
    rows = np.array(sorted(data.draw(st.sets(st.integers(0, len(kind) - 1)))), np.int64)
    found = repeated(corners(kind, view, 20.0, seed=3), rows)
    same = (kind[:, None] == kind) & (view[:, None] == view) & ~np.eye(len(kind), dtype=bool)
    np.testing.assert_array_equal(found, same.any(axis=1)[rows])


def test_one_corner_that_was_found_twice_does_not_repeat() -> None:
    kind, view = np.zeros((2, 2), np.int64)
    assert not repeated(corners(kind, view, 3.0, seed=4), np.arange(2)).any()


def test_what_repeats_is_sought_only_in_views_that_showed_it() -> None:
    world = Map()
    world.points.extend(xyz=np.zeros((4, 3)), repeated=np.array([True, True, False, False]))
    for k, (point, view) in enumerate(((0, 1), (2, 0))):
        world.keyframes.append(Keyframe(k, float(k), np.eye(4), Corners.none(), None, None))
        place = np.zeros((1, 2))
        world.keyframes[k].observations.append(np.array([point]), np.array([view], np.int8), place, place)
    point, view = np.repeat(np.arange(4), 3), np.tile(np.arange(3, dtype=np.int8), 4)
    sought = world.unmistakable(point, view, world.keyframes).reshape(4, 3)
    np.testing.assert_array_equal(sought[0], [False, True, False])
    assert not sought[1].any() and sought[2:].all()
    assert not world.unmistakable(point, view, world.keyframes[1:]).reshape(4, 3)[0].any()
    assert world.unmistakable(point[:0], view[:0], world.keyframes).shape == (0,)
