"""A rig whose views overlap: its map is metric from the first frames on, though the rig stands or turns."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from slam_worlds import folded, single, small

from facetcam.geometry import se3
from facetcam.rig import Rig
from facetcam.simulation.drive import Drive, round_the_table
from facetcam.simulation.film import Film, renderer_of
from facetcam.simulation.mesh_renderer import MeshRenderer
from facetcam.simulation.room import furnished_room
from facetcam.slam import Slam, State, Status
from facetcam.slam.camera.optics import Optics
from facetcam.slam.config import SlamConfig

Array = NDArray[np.float64]

ADAPTER = small(Rig.load(Path(__file__).parents[2] / "examples" / "designs" / "stereo-adapter-rig.yaml"), 800)
FRAMES = 12


@pytest.fixture(scope="module")
def room() -> MeshRenderer:
    return renderer_of(furnished_room())


def drive_of(twist: Array) -> Drive:
    """From the first pose of the built-in drive, with one right-hand twist (6,) a frame."""
    start = round_the_table(1).poses[0]
    return Drive(0.1 * np.arange(FRAMES), np.array([start @ se3.exp(k * twist) for k in range(FRAMES)]))


def filmed(room: MeshRenderer, drive: Drive) -> tuple[Slam, list[State]]:
    slam = Slam(ADAPTER)
    states = [slam.track(image, time) for image, time in zip(Film(ADAPTER, room, drive), drive.times)]
    slam.finish()
    return slam, states


@pytest.mark.parametrize(
    "twist",
    [np.zeros(6), np.array([0.0, 0.0, 0.03, 0.0, 0.0, 0.0]), np.array([0.0, 0.0, 0.0, 0.0, 0.04, 0.0])],
)
def test_the_second_frame_is_found_in_what_the_first_one_saw(room: MeshRenderer, twist: Array) -> None:
    drive = drive_of(twist)
    slam, states = filmed(room, drive)
    assert [s.status for s in states[1:]] == (FRAMES - 1) * [Status.TRACKING]
    times, poses = slam.trajectory()
    np.testing.assert_allclose(times, drive.times)
    true = se3.inverse(drive.poses[0]) @ drive.poses
    off = np.array([se3.log(se3.inverse(a) @ b) for a, b in zip(true, se3.inverse(poses[0]) @ poses)])
    assert np.abs(off[:, :3]).max() < 0.003  # radians
    assert np.abs(off[:, 3:]).max() < 0.01  # metres, of .44 at most
    assert slam.metric or not twist[3:].any()  # nothing has a length where the rig does not move


def test_points_lie_on_the_walls_and_things_that_both_views_see(room: MeshRenderer) -> None:
    drive = drive_of(np.zeros(6))
    slam, _ = filmed(room, drive)
    points = slam.cloud()[0]
    assert len(points) > 100
    T_true = drive.poses[0] @ se3.inverse(slam.trajectory()[1][0])
    origin = se3.transform(drive.poses[0], Optics(ADAPTER, 8.0).T_rig_view[:, :3, 3].mean(axis=0)[None])
    away = se3.transform(T_true, points) - origin
    far = np.linalg.norm(away, axis=1)
    surface = room.trace(np.repeat(origin, len(away), axis=0), away / far[:, None])["distance"]
    off = np.abs(far / surface - 1.0)
    assert np.median(off) < 0.02 and np.mean(off < 0.1) > 0.85


@pytest.mark.parametrize(("rig", "pairs"), [(ADAPTER, [(0, 1)]), (folded(), []), (single(), [])])
def test_views_that_overlap_are_known(rig: Rig, pairs: list[tuple[int, int]]) -> None:
    assert Optics(rig, SlamConfig().seam_margin).overlapping == pairs
