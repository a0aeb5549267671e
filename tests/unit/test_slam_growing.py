"""How the map grows beside tracking."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from slam_worlds import winding_path

from facetcam.slam.camera.frame import Corners
from facetcam.slam.camera.pose import Pose
from facetcam.slam.config import SlamConfig
from facetcam.slam.map.map import Keyframe, Map
from facetcam.slam.map.measure import Measurements
from facetcam.slam.map.trajectory import Trajectory
from facetcam.slam.mapping import loops
from facetcam.slam.mapping.grower import Grower
from facetcam.slam.mapping.loops import LoopCloser
from facetcam.slam.scale.evidence import Evidence
from facetcam.slam.tracking.fix import Fix

Array = NDArray[np.float64]

SOON = 5.0


class Stub:
    """Stands for a part; whatever it is asked, it returns what it was given."""

    indexed = 0
    handovers: Stub
    wheels: Stub

    def __init__(self, **answers: Any) -> None:
        for name, answer in answers.items():
            setattr(self, name, lambda *_, answer=answer: answer)


def tracked_meanwhile(map: Map) -> bool:
    """Tell whether another thread gets the lock of the map soon."""
    done = threading.Event()

    def take() -> None:
        with map.lock:
            done.set()

    threading.Thread(target=take, daemon=True).start()
    return done.wait(SOON)


def driven(poses: Array) -> Map:
    """A map with keyframes at poses (K, 4, 4)."""
    map = Map()
    map.keyframes = [
        Keyframe(k, float(k), T, Corners.none(), Stub(), None)  # type: ignore[arg-type]
        for k, T in enumerate(poses)
    ]
    return map


def returning(monkeypatch: pytest.MonkeyPatch, map: Map, off: tuple[float, float, float]) -> LoopCloser:
    """One that finds the last keyframe at the first one's place, so far off where the map has it."""
    T = map.keyframes[-1].T_world_rig.copy()
    T[:3, 3] += off
    seen = Measurements.none()
    fix = Fix(Pose(T, np.eye(6), np.empty(0)), seen, seen)  # type: ignore[arg-type]
    closer = LoopCloser(map, Stub(), SlamConfig(), Stub(), Stub(), Stub())  # type: ignore[arg-type]
    monkeypatch.setattr(closer, "_tracked", lambda keyframe: None)
    monkeypatch.setattr(closer, "_old_places", lambda keyframe: [np.array([0])])
    monkeypatch.setattr(closer, "_verified", lambda frame, corners, velocity, group: fix)
    return closer


def test_tracking_goes_on_while_a_pose_graph_is_solved(monkeypatch: pytest.MonkeyPatch) -> None:
    map = driven(winding_path(40))
    map.points.extend(xyz=np.zeros((40, 3)))
    for k, keyframe in enumerate(map.keyframes):
        keyframe.observations.point = np.array([k])
    should = map.keyframes[-1].T_world_rig[2, 3] + 0.2
    closer = returning(monkeypatch, map, (0.0, 0.0, 0.2))
    monkeypatch.setattr(closer, "_join", lambda keyframe, ids: None)
    free: list[bool] = []
    relax = loops.relax

    def watched(*arguments: Any, **options: Any) -> Any:
        free.append(tracked_meanwhile(map))
        return relax(*arguments, **options)

    monkeypatch.setattr(loops, "relax", watched)
    mapper = Stub(insert=map.keyframes[-1])
    mapper.handovers = Stub(take_up=None, evidence=Evidence.none())
    adjuster = Stub(adjust_coarsely=None, adjust_all=None, judge=0.001)
    adjuster.nuisances, adjuster.wheels = np.zeros(3), Stub(compare=None)
    others = Stub(add=None), mapper, adjuster, closer, Stub(), Stub(), SlamConfig()
    grower = Grower(map, *others)  # type: ignore[arg-type]
    grower.scale_sigma = 0.001
    grower.grow(None, closer._verified(*4 * [None]), None, Trajectory())  # type: ignore[arg-type]
    assert free == [True]
    assert grower.loops == 1
    assert map.keyframes[-1].T_world_rig[2, 3] == pytest.approx(should, abs=0.04)  # it was 0.2 off


@pytest.mark.parametrize(
    ("away", "metric", "closes"), [(0.3, True, 1), (3.0, True, 0), (0.8, False, 1), (3.0, False, 0)]
)
def test_a_place_farther_off_than_the_map_can_be_is_a_look_alike(
    monkeypatch: pytest.MonkeyPatch, away: float, metric: bool, closes: int
) -> None:
    """Four metres of way: no map that knows its scale is three metres off, nor one whose scale drifts."""
    poses = np.tile(np.eye(4), (41, 1, 1))
    poses[:, 1, 3] = np.linspace(0.0, 4.0, 41)
    map = driven(poses)
    closer = returning(monkeypatch, map, (away, 0.0, 0.0))
    monkeypatch.setattr(closer, "_close", lambda *_: loops.Loop(40, 0, 50, away))
    assert int(closer.close(map.keyframes[-1], metric) is not None) == closes


@pytest.mark.parametrize(("again", "closed"), [(40, 0), (18, 1), (9, 0)])
def test_a_film_may_end_as_its_loop_closes(again: int, closed: int) -> None:
    """Two keyframes see old points in the end, neither enough to close a loop under way: it counts once."""
    map = driven(winding_path(60))
    map.points.extend(xyz=np.zeros((1000, 3)))
    for k, keyframe in enumerate(map.keyframes):
        keyframe.observations.point = np.arange(10 * k, 10 * k + 40)
    last = map.keyframes[-1]
    for first, keyframe in zip((0, 50), (last, map.keyframes[-2])):
        seen = keyframe.observations
        seen.point = np.concatenate([np.arange(first, first + again), seen.point])
    closer = LoopCloser(map, Stub(), SlamConfig(), Stub(), Stub(), Stub())  # type: ignore[arg-type]
    under_way = closer.close(last, metric=True) if again == 40 else None
    assert (under_way is not None) == (again == 40)
    assert [int(closer.ends_in_a_loop()) for _ in range(2)] == [closed, 0]


def test_a_map_without_keyframes_ends_in_no_loop() -> None:
    closer = LoopCloser(Map(), Stub(), SlamConfig(), Stub(), Stub(), Stub())  # type: ignore[arg-type]
    assert not closer.ends_in_a_loop()
