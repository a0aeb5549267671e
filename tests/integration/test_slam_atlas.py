"""A rig that is lost for good begins another map, and goes on in the first one where it sees that again."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from slam_worlds import folded

from facetcam.evaluation.trajectory import evaluate
from facetcam.simulation.drive import Drive, round_the_table
from facetcam.simulation.film import Film, renderer_of
from facetcam.simulation.room import furnished_room
from facetcam.slam import Slam, State, Status
from facetcam.slam.map.file import read_map

Image = NDArray[np.uint8]

LEAVES, MEETS, FRAMES = 26, 44, 70
BLIND = 3.0  # seconds between two rooms
LATER = range(LEAVES - 5, FRAMES)  # frames that a second run sees
RETURNS = range(8, 18)  # frames of the first room, seen once more


@pytest.fixture(scope="module")
def drive() -> Drive:
    return round_the_table(FRAMES)


@pytest.fixture(scope="module")
def images(drive: Drive) -> list[Image]:
    return list(Film(folded(), renderer_of(furnished_room()), drive))


def track(
    images: list[Image], drive: Drive, look: Callable[[int, Image], Image], leaves: int = LEAVES
) -> tuple[Slam, list[State]]:
    """Track a film whose frames come `BLIND` seconds later from one on."""
    slam, states = Slam(folded()), []
    for k, image in enumerate(images):
        states.append(slam.track(look(k, image), drive.times[k] + BLIND * (k >= leaves)))
    return slam, states


def elsewhere(k: int, image: Image) -> Image:
    """Bright is dark in the other room."""
    return image if k < LEAVES else 255 - image


@pytest.fixture(scope="module")
def parted(images: list[Image], drive: Drive) -> tuple[Slam, list[State]]:
    return track(images, drive, elsewhere)


def test_a_rig_that_sees_nothing_of_its_map_begins_another(parted: tuple[Slam, list[State]]) -> None:
    _, states = parted
    assert states[LEAVES - 1].status is Status.TRACKING
    assert states[LEAVES].status is Status.LOST
    assert {state.map for state in states[:LEAVES]} == {0}
    assert states[-1].status is Status.TRACKING
    assert states[-1].map != 0
    began = next(s for s in states[LEAVES:] if s.status is Status.TRACKING)
    assert began.T_world_rig is not None and np.linalg.norm(began.T_world_rig[:3, 3]) < 1.0


def test_a_rig_that_comes_back_is_found_in_its_first_map(
    parted: tuple[Slam, list[State]], drive: Drive, images: list[Image]
) -> None:
    slam, states = parted
    start = states[-1].timestamp + BLIND
    back = [slam.track(images[k], start + k / 10) for k in RETURNS]
    found = [k for k, state in zip(RETURNS, back) if state.status is Status.TRACKING]
    assert len(found) >= len(RETURNS) - 3
    assert back[-1].map == 0
    before, after = states[RETURNS[-1]].T_world_rig, back[-1].T_world_rig
    assert before is not None and after is not None
    np.testing.assert_allclose(after[:3, 3], before[:3, 3], atol=0.1)


def test_each_map_keeps_its_own_path(parted: tuple[Slam, list[State]], drive: Drive) -> None:
    slam, states = parted
    slam.finish()
    paths = [slam.trajectory(), *slam.trajectories_apart().values()]
    assert len(paths) == 2
    assert len(paths[0][0]) >= len(paths[1][0])
    times = np.array([state.timestamp for state in states])
    for path in paths:
        errors = evaluate(path, (times, drive.poses), max_gap=0.001)
        assert errors.ate_scaled.rmse < 0.02
    assert sum(len(path[0]) for path in paths) > FRAMES - 10
    assert np.diff(paths[0][0]).max() < 0.15  # frames between the two that began it have poses, too


@pytest.mark.parametrize(("leaves", "meets"), [(28, 46), (LEAVES, MEETS)])
def test_maps_are_joined_where_they_meet(images: list[Image], drive: Drive, leaves: int, meets: int) -> None:
    """Two mirrors show the first room again while the others still show the second one."""
    rig = folded()
    again = np.isin(rig.labels(), [rig.view_names.index(name) for name in rig.view_names[::2]])[:, :, None]

    def look(k: int, image: Image) -> Image:
        other = image if k < leaves else 255 - image
        return other if k < meets else np.where(again, image, other)

    slam, states = track(images, drive, look, leaves)
    assert states[meets - 1].map != 0
    assert states[-1].map == 0
    assert all(state.status is Status.TRACKING for state in states[meets:])
    slam.finish()
    assert slam.trajectories_apart() == {}
    times = drive.times + BLIND * (np.arange(FRAMES) >= leaves)
    errors = evaluate(slam.trajectory(), (times, drive.poses), max_gap=0.001)
    assert errors.matched > FRAMES - 15
    assert errors.ate_scaled.max < 0.05


@pytest.mark.slow
def test_what_is_saved_is_the_loaded_map_however_long_the_rig_was_elsewhere(
    images: list[Image], drive: Drive, tmp_path: Path
) -> None:
    first, _ = track(images[:LEAVES], drive, elsewhere)
    first.finish()
    first.save_map(tmp_path / "house.facetmap")
    slam = Slam(folded())
    slam.load_map(tmp_path / "house.facetmap")
    loaded = len(slam.keyframe_poses)
    states = [slam.track(elsewhere(k, images[k]), drive.times[k] + BLIND * (k >= LEAVES)) for k in LATER]
    assert (states[0].status, states[0].map) == (Status.TRACKING, 0)
    assert states[-1].status is Status.TRACKING and states[-1].map != 0
    slam.save_map(tmp_path / "house.facetmap")
    assert read_map(tmp_path / "house.facetmap")[0].keyframes == loaded
    slam.finish()
    assert len(slam.keyframe_poses) == loaded
    ((number, (times, _)),) = slam.trajectories_apart().items()
    assert number == states[-1].map and len(times) > len(LATER) // 2
    slam.save_map(tmp_path / "elsewhere.facetmap", number)
    assert read_map(tmp_path / "elsewhere.facetmap")[0].keyframes != loaded
