"""SLAM on films of the built-in room, against the drive that made them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2
from slam_worlds import folded, single, small

from facetcam.errors import FacetcamError
from facetcam.evaluation.trajectory import TrajectoryErrors, evaluate, scale_error
from facetcam.geometry import se3
from facetcam.rig import Rig
from facetcam.simulation.drive import Drive, round_the_table, wheel_odometry
from facetcam.simulation.film import Film, renderer_of
from facetcam.simulation.mesh_renderer import MeshRenderer
from facetcam.simulation.room import furnished_room
from facetcam.slam import Slam, State, Status

Array = NDArray[np.float64]
Images = list[NDArray[np.uint8]]

FRAMES = 30
BLACKOUT = slice(22, 25)


@dataclass(slots=True)
class Shot:
    """A film with the truth and the wheels of its drive."""

    rig: Rig
    images: Images
    drive: Drive
    wheels: Array


@dataclass(slots=True)
class Run:
    """What SLAM made of a film."""

    slam: Slam
    states: list[State]

    def errors(self, drive: Drive) -> TrajectoryErrors:
        return evaluate(self.slam.trajectory(), (drive.times, drive.poses), max_gap=0.001)


def run(shot: Shot, wheels: Array | None = None, images: Images | None = None) -> Run:
    slam, states = Slam(shot.rig), []
    for k, image in enumerate(images or shot.images):
        states.append(slam.track(image, shot.drive.times[k], None if wheels is None else wheels[k]))
    slam.finish()
    return Run(slam, states)


@pytest.fixture(scope="module")
def room() -> MeshRenderer:
    return renderer_of(furnished_room())


@pytest.fixture(scope="module")
def shot(room: MeshRenderer) -> Shot:
    drive = round_the_table(FRAMES)
    film = Film(folded(), room, drive)
    return Shot(film.rig, list(film), drive, wheel_odometry(drive))


@pytest.fixture(scope="module")
def with_wheels(shot: Shot) -> Run:
    return run(shot, shot.wheels)


@pytest.fixture(scope="module")
def by_sight(shot: Shot) -> Run:
    return run(shot)


def statuses(result: Run) -> list[Status]:
    return [state.status for state in result.states]


def test_every_frame_of_a_drive_with_wheels_is_posed(shot: Shot, with_wheels: Run) -> None:
    errors = with_wheels.errors(shot.drive)
    assert errors.matched == FRAMES
    assert errors.ate.rmse < 0.01
    assert np.degrees(errors.rpe_rotation.max) < 0.5
    assert statuses(with_wheels)[-20:] == [Status.TRACKING] * 20
    poses = with_wheels.slam.trajectory()[1]
    assert all(se3.assert_proper_rotation(T[:3, :3]).shape == (3, 3) for T in poses)


def test_mirrors_correct_the_wheels_scale(shot: Shot, with_wheels: Run) -> None:
    """The wheels report 4 % too much."""
    assert with_wheels.slam.metric
    assert abs(with_wheels.errors(shot.drive).scale_error) < 0.01


def test_a_drive_by_sight_alone_is_posed(shot: Shot, by_sight: Run) -> None:
    errors = by_sight.errors(shot.drive)
    assert errors.matched == FRAMES
    assert errors.ate_scaled.rmse < 0.015


@pytest.mark.parametrize("creep", [(0.0, 0.0), (-0.3, 0.7)])
def test_a_camera_that_has_crept_is_noticed(shot: Shot, creep: tuple[float, float]) -> None:
    x, y = creep
    camera = shot.rig.camera
    filed = replace(shot.rig, camera=replace(camera, cx=camera.cx - x, cy=camera.cy - y))
    found = run(replace(shot, rig=filed), shot.wheels)
    assert found.slam.nuisances[1:] == pytest.approx(creep, abs=0.2)
    assert found.slam.rig_as_seen.camera.cy == pytest.approx(camera.cy, abs=0.2)
    assert abs(found.errors(shot.drive).scale_error) < 0.01


def test_no_scale_is_claimed_of_a_rig_that_the_images_deny(
    with_wheels: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(with_wheels.slam.rig_check, "misfit", 2.0)
    assert not with_wheels.slam.metric


def test_a_map_that_is_called_metric_has_the_scale_it_claims(shot: Shot, by_sight: Run) -> None:
    slam = by_sight.slam
    assert slam.metric == (slam.scale_sigma < slam.config.metric_sigma)
    times = [k for k, state in enumerate(by_sight.states) if state.keyframe]
    own, true = slam.keyframe_poses[1:, :3, 3], shot.drive.poses[times, :3, 3]
    assert len(own) == len(true) > 5
    assert not slam.metric or abs(scale_error(own, true)) < 4.0 * slam.scale_sigma


def test_states_tell_what_was_measured(shot: Shot, by_sight: Run) -> None:
    names = shot.rig.view_names
    state = by_sight.states[-1]
    assert set(state.views) == set(names)
    assert sum(view.inliers for view in state.views.values()) == len(state.pixels) == len(state.pixel_views)
    assert all(view.inliers <= view.predicted for view in state.views.values())
    columns, rows = np.rint(state.pixels).astype(int).T
    assert np.array_equal(shot.rig.labels()[rows, columns], state.pixel_views)
    assert state.covariance is not None
    assert np.all(np.linalg.eigvalsh(state.covariance) > 0)
    assert 0.0 < np.sqrt(np.trace(state.covariance[3:, 3:])) < 0.02


def test_live_poses_are_as_unsure_as_they_say_from_the_start(shot: Shot, by_sight: Run) -> None:
    """Turns against the first keyframe: of a map by sight they alone need no metre."""
    began = next(k for k, state in enumerate(by_sight.states) if state.keyframe)
    first = by_sight.slam.keyframe_poses[0]
    nees = []
    for k, state in enumerate(by_sight.states[began + 1 :], began + 1):
        assert state.T_world_rig is not None and state.covariance is not None
        turned = se3.inverse(shot.drive.poses[0]) @ shot.drive.poses[k]
        error = se3.log(se3.inverse(turned) @ se3.inverse(first) @ state.T_world_rig)[:3]
        nees.append(float(error @ np.linalg.solve(state.covariance[:3, :3], error)))
    assert np.mean(np.array(nees) < chi2.ppf(0.9973, 3)) >= 0.9


def test_all_points_behind_the_last_keyframes_were_found_again(by_sight: Run) -> None:
    map, window = by_sight.slam._map, by_sight.slam.config.window
    left, kept = map.keyframes[:-window], map.keyframes[-window:]
    ids = np.setdiff1d(map.observed_points(left), map.observed_points(kept))
    assert len(ids) > 20
    assert map.points.found[ids].min() > 0


def test_the_cloud_lies_in_the_room(room: MeshRenderer, shot: Shot, with_wheels: Run) -> None:
    """Most points lie on the surface that a ray to them meets, to some hundredths of their distance."""
    points, colours = with_wheels.slam.cloud()
    assert len(points) == len(colours) > 300
    times, poses = with_wheels.slam.trajectory()
    T_true_own = shot.drive.poses[-1] @ se3.inverse(poses[-1])
    assert times[-1] == shot.drive.times[-1]
    own = se3.transform(T_true_own, points)
    eye = shot.drive.poses[-1][:3, 3]
    away = own - eye
    distance = np.linalg.norm(away, axis=1)
    hits = room.trace(eye, away / distance[:, None])
    gap = np.abs(hits["distance"] / distance - 1.0)
    assert np.median(gap) < 0.02


def test_two_runs_agree_to_the_byte(shot: Shot, by_sight: Run) -> None:
    again = run(shot)
    for first, second in zip(by_sight.slam.trajectory(), again.slam.trajectory()):
        assert first.tobytes() == second.tobytes()
    assert [s.map_points for s in by_sight.states] == [s.map_points for s in again.states]
    assert by_sight.slam.scale_sigma == again.slam.scale_sigma


def darkened(shot: Shot) -> Images:
    images = list(shot.images)
    images[BLACKOUT] = [np.zeros_like(image) for image in images[BLACKOUT]]
    return images


def test_a_blackout_loses_a_rig_without_wheels_for_as_long_as_it_lasts(shot: Shot) -> None:
    result = run(shot, images=darkened(shot))
    assert statuses(result)[BLACKOUT] == [Status.LOST] * 3
    assert all(state.T_world_rig is None for state in result.states[BLACKOUT])
    assert statuses(result)[26:] == [Status.TRACKING] * (FRAMES - 26)
    errors = result.errors(shot.drive)
    assert errors.matched == sum(state.status is not Status.LOST for state in result.states)
    assert errors.ate_scaled.rmse < 0.02


@pytest.mark.slow
@pytest.mark.parametrize("dark", [16, 18, 20])
def test_no_wrong_pose_is_believed_after_a_blackout(room: MeshRenderer, dark: int) -> None:
    drive = round_the_table(45)
    film = Film(folded(), room, drive)
    images = [np.zeros_like(im) if dark <= k < dark + 3 else im for k, im in enumerate(film)]
    result = run(Shot(film.rig, images, drive, wheel_odometry(drive)))
    assert statuses(result)[-10:] == [Status.TRACKING] * 10
    assert result.errors(drive).ate.max < 0.05


def test_wheels_carry_a_rig_through_a_blackout(shot: Shot) -> None:
    result = run(shot, shot.wheels, darkened(shot))
    assert statuses(result)[BLACKOUT] == [Status.DEAD_RECKONING] * 3
    assert statuses(result)[25:] == [Status.TRACKING] * (FRAMES - 25)
    errors = result.errors(shot.drive)
    assert errors.matched == FRAMES
    assert errors.ate.max < 0.05


@pytest.mark.parametrize("factors", [(0.0, 0.0, 0.0), (1000.0, 1000.0, 1.0)], ids=["standing", "mm"])
def test_wheels_that_tell_nonsense_do_no_harm(
    shot: Shot, by_sight: Run, factors: tuple[float, float, float]
) -> None:
    result = run(shot, shot.wheels * factors)
    assert statuses(result)[-20:] == [Status.TRACKING] * 20
    alone, errors = by_sight.errors(shot.drive), result.errors(shot.drive)
    assert errors.ate_scaled.rmse < 1.5 * alone.ate_scaled.rmse
    assert errors.ate.rmse < 1.5 * alone.ate.rmse


def test_a_young_map_that_stays_lost_is_given_up(shot: Shot) -> None:
    black = np.zeros_like(shot.images[0])
    slam = Slam(shot.rig)
    states = [slam.track(image, k / 10) for k, image in enumerate(shot.images[:8] + 12 * [black])]
    assert states[7].status is Status.TRACKING
    assert states[-1].status is Status.STARTING
    assert len(slam.trajectory()[0]) == 0
    assert not slam.metric


def test_one_camera_starts_but_cannot_know_the_metre(room: MeshRenderer) -> None:
    drive = round_the_table(25)
    film = Film(small(single(), 480), room, drive)
    result = run(Shot(film.rig, list(film), drive, wheel_odometry(drive)))
    assert statuses(result)[-1] is Status.TRACKING
    assert result.slam.scale_sigma == np.inf
    assert not any(state.metric for state in result.states)
    errors = result.errors(drive)
    assert errors.matched > 15
    assert errors.ate_scaled.rmse < 0.05


def standing(shot: Shot) -> Images:
    """One place with fresh noise on every frame."""
    rng = np.random.default_rng(41)
    image = shot.images[0].astype(float)
    return [np.clip(image + rng.normal(0, 2.5, image.shape), 0, 255).astype(np.uint8) for _ in range(8)]


def black(shot: Shot) -> Images:
    return [np.zeros_like(shot.images[0])] * 5


@pytest.mark.parametrize("film", [standing, black])
def test_no_motion_is_invented(shot: Shot, film: Callable[[Shot], Images]) -> None:
    result = run(shot, images=film(shot))
    assert set(statuses(result)) == {Status.STARTING}
    assert all(state.T_world_rig is None for state in result.states)
    assert len(result.slam.trajectory()[0]) == len(result.slam.cloud()[0]) == 0
    assert not result.slam.metric


def test_a_standing_rig_stays_where_its_wheels_are(shot: Shot) -> None:
    result = run(shot, np.zeros((8, 3)), standing(shot))
    assert set(statuses(result)) == {Status.STARTING}
    poses = [state.T_world_rig for state in result.states]
    assert all(T is not None and np.array_equal(T[:3, 3], np.zeros(3)) for T in poses)


@pytest.mark.parametrize(
    ("image", "time", "wheels", "says"),
    [
        (np.zeros((600, 801), np.uint8), 1.0, None, "801x600"),
        (np.zeros((600, 800), np.float32), 1.0, None, "float32"),
        (np.zeros((600, 800), np.uint8), 0.5, None, "sort the frames"),
        (np.zeros((600, 800), np.uint8), 0.4, None, "sort the frames"),
        (np.zeros((600, 800), np.uint8), np.nan, None, "sort the frames"),
        (np.zeros((600, 800), np.uint8), 1.0, (0.0, np.nan, 0.0), "finite"),
        (np.zeros((600, 800), np.uint8), 1.0, (0.0, 1.0), "finite"),
    ],
)
def test_what_cannot_be_tracked_is_refused_and_the_next_frame_taken(
    image: NDArray, time: float, wheels: tuple[float, ...] | None, says: str
) -> None:
    slam = Slam(folded())
    dark = np.zeros((600, 800), np.uint8)
    slam.track(dark, 0.5)
    with pytest.raises(FacetcamError, match=says) as caught:
        slam.track(image, time, wheels)
    assert "\n" not in str(caught.value)
    assert slam.track(dark, 1.0).status is Status.STARTING


def test_finishing_without_a_map_is_quiet() -> None:
    slam = Slam(folded())
    slam.finish()
    slam.finish()
    assert slam.scale_sigma == np.inf
    assert slam.keyframe_poses.shape == (0, 4, 4)
