"""Points mapped far away: sought where others of their keyframes were seen last, and missed without harm."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import pytest
from slam_worlds import single

from facetcam.geometry import se3
from facetcam.slam.camera.corner_finder import CornerFinder
from facetcam.slam.camera.frame import Corners, Frame
from facetcam.slam.camera.optics import Optics
from facetcam.slam.camera.pose import Pose
from facetcam.slam.camera.sight import Sights
from facetcam.slam.config import SlamConfig
from facetcam.slam.map.map import Keyframe, Map
from facetcam.slam.map.measure import Measurements, Predictions
from facetcam.slam.tracking import tracker as tracker_module
from facetcam.slam.tracking.relocaliser import Relocaliser
from facetcam.slam.tracking.tracker import Tracker

KEYFRAMES, POINTS = 30, 40  # of each keyframe, none of them shared
HERE = se3.exp([0.0, 0.0, 0.0, 0.2 * KEYFRAMES, 0.0, 0.0])
FIRST, LAST = np.arange(POINTS), np.arange(POINTS) + POINTS * (KEYFRAMES - 1)


def street() -> Map:
    """A map of keyframes one behind the other."""
    world = Map()
    world.points.extend(xyz=np.zeros((KEYFRAMES * POINTS, 3)))
    for k in range(KEYFRAMES):
        corners = Corners.none()
        T = se3.exp([0.0, 0.0, 0.0, 0.2 * k, 0.0, 0.0])
        world.keyframes.append(Keyframe(k, float(k), T, corners, None, None))
        world.keyframes[-1].observations.append(*rows(np.arange(POINTS) + POINTS * k))
    return world


def rows(ids: np.ndarray) -> tuple[Any, ...]:
    return ids, np.zeros(len(ids), np.int8), np.zeros((len(ids), 2)), np.zeros((len(ids), 2))


def tracker(world: Map, seen_last: np.ndarray) -> Tracker:
    parts = cast(CornerFinder, None), cast(Relocaliser, None)
    found = Tracker(world, Optics(single(), 8.0), SlamConfig(), *parts)
    found._last = (cast(Frame, None), Measurements(*rows(seen_last)), world.points)
    return found


def found_of(
    monkeypatch: pytest.MonkeyPatch, seen_last: np.ndarray, there: np.ndarray, blank: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """Points that are expected and seen from the end of the street, where only some are `there`."""

    def blank_views(*_: object) -> np.ndarray:
        return np.array([blank])

    def predict(_: object, ids: np.ndarray, *__: object) -> Predictions:
        n = len(ids)
        return Predictions(ids, np.zeros(n, np.int8), np.zeros((n, 2)), np.zeros((n, 2, 2)))

    def measure(_: object, expected: Predictions, *__: object) -> tuple[Measurements, np.ndarray]:
        hit = np.isin(expected.point, there)
        return Measurements(*rows(expected.point[hit])), hit

    def refine(T: np.ndarray, seen: Sights, *_: object) -> Pose:
        return Pose(T, np.eye(6), np.full(len(seen.points), 0.1))

    for fake in (predict, measure, blank_views):
        monkeypatch.setattr(tracker_module, fake.__name__, fake)
    monkeypatch.setattr(tracker_module, "refine_pose", refine)
    fix = tracker(street(), seen_last).locate(cast(Frame, None), HERE)
    assert fix is not None
    return fix.predictions.point, fix.seen.point


def test_what_another_view_sees_again_is_found_and_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    expected, seen = found_of(monkeypatch, seen_last=FIRST[:3], there=np.concatenate([FIRST, LAST]))
    assert np.isin(FIRST, seen).all() and np.isin(FIRST, expected).all()


def test_points_far_away_are_not_sought_where_none_of_their_keyframe_was_seen(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    _, seen = found_of(monkeypatch, seen_last=LAST, there=np.concatenate([FIRST, LAST]))
    assert not np.isin(FIRST, seen).any() and np.isin(LAST, seen).all()


def test_hidden_points_count_as_missed_only_where_they_are_near(monkeypatch: pytest.MonkeyPatch) -> None:
    expected, seen = found_of(monkeypatch, seen_last=FIRST[:3], there=LAST)
    assert not np.isin(FIRST, expected).any()
    beside = LAST - POINTS
    assert np.isin(beside, expected).all() and not np.isin(beside, seen).any()


def test_blank_views_miss_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    expected, seen = found_of(monkeypatch, seen_last=FIRST[:3], there=LAST, blank=True)
    np.testing.assert_array_equal(np.sort(expected), np.sort(seen))
