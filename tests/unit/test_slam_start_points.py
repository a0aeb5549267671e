"""A first map: points that the frames between its two keyframes show, too, and frames from before it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from slam_worlds import distinct_corners, folded

from facetcam.geometry import se3
from facetcam.slam.camera.frame import Frame
from facetcam.slam.camera.patches import PATCH_SIZE
from facetcam.slam.config import SlamConfig
from facetcam.slam.map.map import Keyframe
from facetcam.slam.mapping.starter import _halving, _of_its_length
from facetcam.slam.mapping.trial import Trial
from facetcam.slam.parts import Parts
from facetcam.slam.relative_pose.two_frames import MIN_MATCHES

N = 46  # points, of which view 1 shows 40 and view 0 the rest


def dropped(frames: int, lacking: list[int]) -> list[int]:
    """Points that a start drops where `frames` frames show all but some."""
    parts = Parts.assemble(folded(), SlamConfig())
    points = parts.map.points
    columns = {n: np.zeros((N, *getattr(points, n).shape[1:]), getattr(points, n).dtype) for n in POINTS}
    ids = points.extend(**columns)
    view = np.where(ids < 40, 1, 0).astype(np.int8)
    for k in range(2):
        keyframe = Keyframe(k, 0.1 * k, np.eye(4), cast(Any, None), None, None)
        keyframe.observations.append(ids, view, np.zeros((N, 2)), np.zeros((N, 2)))
        parts.map.keyframes.append(keyframe)
    rows = []
    parts.mapper.drop = lambda given: rows.append(np.flatnonzero(given))  # type: ignore[method-assign]
    seen = np.setdiff1d(ids, lacking)
    fix = SimpleNamespace(predictions=SimpleNamespace(point=ids), seen=SimpleNamespace(point=seen))
    Trial(parts.map, parts.mapper, parts.tracker)._drop_rare([cast(Any, fix)] * frames)
    return cast(list[int], rows[0].tolist())


POINTS = ("xyz", "patch", "offset", "tangent", "jacobian", "descriptor", "colour", "predicted", "found")


def test_a_point_that_most_frames_lack_is_dropped() -> None:
    assert dropped(4, [3, 17]) == [3, 17]


def test_too_few_frames_tell_nothing() -> None:
    assert dropped(2, [3, 17]) == []


def test_a_view_that_lacks_many_is_heard_all_the_same() -> None:
    """Half of the six points that may tell the scale: then rather the scale is wrong."""
    assert dropped(4, [3, 41, 43, 45]) == [3]


def test_frames_from_before_the_map_are_sought_where_the_rig_came_from() -> None:
    """Ten centimetres and a degree a frame: patches reach less far than the rig goes."""
    twist = np.array([0.0, 0.0, 0.175, 1.0, 0.1, 0.0])  # a second
    sought = {}

    def find(frame: Any, *predicted: Any) -> Any:
        sought[frame.timestamp] = predicted[0]
        return SimpleNamespace(clear=frame.timestamp > 0.45, T_world_rig=se3.exp(frame.timestamp * twist))

    parts = Parts.assemble(folded(), SlamConfig())
    trial = Trial(parts.map, parts.mapper, cast(Any, SimpleNamespace(find=find)))
    times = (0.1, 0.3, 0.4, 0.5, 0.6, 0.8)  # one frame is missing
    passed = [SimpleNamespace(frame=SimpleNamespace(timestamp=t)) for t in times]
    a, b = (Keyframe(k, t, se3.exp(t * twist), cast(Any, None), None, None) for k, t in enumerate((0.9, 1.4)))
    solved = trial.before(a, b, cast(Any, passed))
    assert [time for time, _ in solved] == [0.8, 0.6, 0.5]
    assert sorted(sought) == [0.4, 0.5, 0.6, 0.8]  # the first one that is not clear ends it
    for time, T in sought.items():
        np.testing.assert_allclose(T, se3.exp(time * twist), atol=1e-9)


def test_a_motion_by_sight_is_as_long_as_proven_wheels_say_or_nothing() -> None:
    wheels = se3.exp([0.0, 0.0, 0.1, 0.02, 0.2, 0.0])
    seen = se3.exp([0.03, 0.02, 0.11, 0.0, 0.5, 0.02])  # a ramp, and another length
    T = _of_its_length(seen, wheels)
    assert T is not None
    np.testing.assert_allclose(T[:3, :3], seen[:3, :3])
    assert np.linalg.norm(T[:3, 3]) == pytest.approx(np.linalg.norm(wheels[:3, 3]))
    assert np.linalg.norm(np.cross(T[:3, 3], seen[:3, 3])) < 1e-12
    assert _of_its_length(se3.exp([0.0, 0.0, 0.1, 0.3, 0.2, 0.0]), wheels) is None  # another way
    assert _of_its_length(seen, np.eye(4)) is None  # wheels that stand


@pytest.mark.parametrize(("bend", "starts"), [(0, False), (1, True)])
def test_a_map_begins_at_once_with_corners_not_with_edges(bend: int, starts: bool) -> None:
    """Points enough, whose patches show the rim of a wall, or its corner."""
    parts = Parts.assemble(folded(), SlamConfig())
    points, many = parts.map.points, 2 * MIN_MATCHES
    columns = {n: np.zeros((many, *getattr(points, n).shape[1:]), getattr(points, n).dtype) for n in POINTS}
    columns["patch"][:, :, PATCH_SIZE // 2 :] = 180
    columns["patch"][:, : bend * PATCH_SIZE // 2] = 0
    points.extend(**columns)
    assert parts.starter._has_corners() == starts


@pytest.mark.parametrize(("waiting", "rows"), [(6, []), (7, [3]), (16, [8, 12]), (40, [20, 30, 35])])
def test_a_start_is_sought_over_ever_shorter_ways(waiting: int, rows: list[int]) -> None:
    """What a view shows for half a second alone tells a motion then, or never."""
    assert _halving(waiting) == rows


def with_corners(time: float, count: int) -> Frame:
    """A frame in which so many corners were found."""
    looks = np.random.default_rng(7).integers(0, 256, (count, 32), np.uint8)
    places = np.random.default_rng(8).uniform(50.0, 500.0, (count, 2))
    corners = distinct_corners(places, np.zeros(count, np.int8), places, looks)
    nothing = np.zeros((600, 800), np.uint8)
    return Frame(time, None, nothing, nothing[::2, ::2], corners)


def test_frames_of_a_rig_just_lost_wait_for_its_next_map() -> None:
    """They are links of the chain that a later start follows; a frame that shows nothing breaks it."""
    parts = Parts.assemble(folded(), SlamConfig())
    starter = parts.resumer._starter
    for k in range(8):
        parts.resumer.keep(with_corners(0.1 * k, 80))
    assert [round(10 * w.frame.timestamp) for w in starter._waiting] == list(range(8))
    assert len(starter._pairs(0)) == 80 and parts.resumer.in_vain
    parts.resumer.keep(with_corners(0.8, 5))
    assert not starter._waiting and not parts.resumer.in_vain
