"""Which hand-overs can tell the scale."""

import numpy as np

from facetcam.slam.camera.frame import Corners
from facetcam.slam.map.map import HandedOver, Keyframe
from facetcam.slam.scale.handovers import mapped_nearby

LEAST = 15


def keyframe(index: int, points: range, view: int) -> Keyframe:
    made = Keyframe(index, float(index), np.eye(4), Corners.none(), None, None)
    ids, nowhere = np.array(points), np.zeros((len(points), 2))
    made.observations.append(ids, np.full(len(ids), view, np.int8), nowhere, nowhere)
    return made


def handed_over(points: list[int]) -> HandedOver:
    """From view 0 to view 1."""
    view, n = np.ones(len(points), np.int8), len(points)
    return HandedOver(np.array(points), 0 * view, view, np.zeros((n, 2)))


def test_hand_overs_that_placed_a_part_of_the_map_tell_no_scale() -> None:
    """View 0 maps ten keyframes, each with points of the last; only view 1 ties the next ones to them."""
    keyframes = [keyframe(k, range(10 * k, 10 * k + 50), 0) for k in range(10)]
    keyframes += [keyframe(k, range(100, 150), 1) for k in (10, 11)]
    own = keyframe(11, range(300, 340), 0).observations
    keyframes[-1].observations.append(own.point, own.view, own.pixels, own.plane)
    found = [handed_over([]) for _ in keyframes]
    found[9], found[10], found[11] = handed_over([3, 95]), handed_over([100, 120]), handed_over([100, 310])
    told = [f.point.tolist() for f in mapped_nearby(keyframes, found, LEAST)]
    assert told == 9 * [[]] + [[3, 95], [], [310]]


def test_a_view_that_sees_an_old_place_again_ties_the_map() -> None:
    keyframes = [keyframe(k, range(100 * k, 100 * k + 50), 0) for k in range(3)]
    keyframes.append(keyframe(3, range(20), 0))
    found = [handed_over([]), handed_over([]), handed_over([]), handed_over([5, 45, 105])]
    assert mapped_nearby(keyframes, found, LEAST)[3].point.tolist() == [5, 45]


def test_keyframes_that_saw_nothing_tell_nothing() -> None:
    keyframes = [keyframe(k, range(0), 0) for k in range(2)]
    assert [len(f) for f in mapped_nearby(keyframes, [handed_over([]), handed_over([7])], LEAST)] == [0, 0]
