"""Map points followed by optical flow, in rendered frames before and after a jerk."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from slam_worlds import folded

from facetcam.geometry import se3
from facetcam.simulation.drive import Drive, round_the_table
from facetcam.simulation.film import Film, renderer_of
from facetcam.simulation.mesh_renderer import MeshRenderer
from facetcam.simulation.room import furnished_room
from facetcam.slam.camera.corner_finder import CornerFinder, SiicfFeatures
from facetcam.slam.camera.frame import Frame, make_frame
from facetcam.slam.camera.optics import Optics
from facetcam.slam.config import SlamConfig
from facetcam.slam.map.measure import Measurements
from facetcam.slam.tracking.flow import pose_by_flow

Array = NDArray[np.float64]

JERKS = {"nod": [0.03, 0.0, 0.0], "roll": [0.0, 0.03, 0.0], "turn": [0.0, 0.0, 0.04]}  # radians


@pytest.fixture(scope="module")
def optics() -> Optics:
    return Optics(folded(), 8.0)


@pytest.fixture(scope="module")
def room() -> MeshRenderer:
    return renderer_of(furnished_room())


def jerk(
    optics: Optics, room: MeshRenderer, turn: list[float]
) -> tuple[Frame, Frame, Measurements, Array, Array, Array]:
    """Frames before and after, the corners of the first with their places in the room, and both poses."""
    start = round_the_table(2).poses[0]
    poses = np.array([start, start @ se3.exp([*turn, 0.01, 0.04, 0.01])])
    film = Film(optics.rig, room, Drive(np.array([0.0, 0.1]), poses))
    before, after = (make_frame(image, t, optics.rig.size) for image, t in zip(film, (0.0, 0.1)))
    corners = CornerFinder(optics, 400, SiicfFeatures)(before)
    origins = se3.transform(start, optics.origins(corners.views))
    rays = optics.rays(corners.pixels, corners.views) @ start[:3, :3].T
    hits = room.trace(origins, rays)
    xyz = origins + hits["distance"][:, None].astype(np.float64) * rays
    seen = Measurements(np.arange(len(corners)), corners.views, corners.pixels, corners.plane)
    return before, after, seen, xyz, poses[0], poses[1]


@pytest.mark.parametrize("turn", JERKS.values(), ids=JERKS.keys())
def test_a_jerk_is_followed(optics: Optics, room: MeshRenderer, turn: list[float]) -> None:
    """Corners move by up to 30 pixels: more than the eight that a patch can bridge."""
    before, after, seen, xyz, start, end = jerk(optics, room, turn)
    found = pose_by_flow(before, seen, xyz, after, start, optics, SlamConfig())
    assert found is not None
    off = se3.log(se3.inverse(end) @ found)
    assert np.degrees(np.linalg.norm(off[:3])) < 0.2
    assert np.linalg.norm(off[3:]) < 0.02


def test_nothing_is_followed_where_nothing_was_seen(optics: Optics, room: MeshRenderer) -> None:
    before, after, _, _, start, _ = jerk(optics, room, [0.0, 0.0, 0.0])
    nothing = Measurements.none()
    assert pose_by_flow(before, nothing, np.empty((0, 3)), after, start, optics, SlamConfig()) is None
