"""Maps of a real length of film that start by sight alone, at odd moments, against the truth of the drive."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from facetcam.geometry import se3
from facetcam.io.trajectories import read_tum
from facetcam.rig import Rig
from facetcam.slam import Slam, Status

PATIENCE = 20  # frames


@pytest.mark.parametrize("first", [0, 100, 200])
def test_a_map_starts_with_the_motion_that_was_driven(shared_data: Path, first: int) -> None:
    """From frame 100 on a world a fifteenth as large explains the first pairs better than the true one."""
    house = shared_data / "house"
    times, poses = read_tum(house / "loop.tum")
    film = cv2.VideoCapture(str(house / "loop.mp4"))
    film.set(cv2.CAP_PROP_POS_FRAMES, first)
    slam = Slam(Rig.load(house / "rig_true.yaml"))
    for time in times[first : first + PATIENCE]:
        if slam.track(film.read()[1], time).status is Status.TRACKING:
            break
    when, own = slam.trajectory()
    assert len(own) > 1, "no start"
    true = poses[np.searchsorted(times, when - 1e-6)]
    T_own, T_true = (se3.inverse(T[0]) @ T[-1] for T in (own, true))
    assert np.degrees(np.linalg.norm(se3.log(se3.inverse(T_own) @ T_true)[:3])) < 0.2
    a, b = T_own[:3, 3], T_true[:3, 3]
    assert np.degrees(np.arccos(a @ b / np.linalg.norm(a) / np.linalg.norm(b))) < 3.0
