"""Live poses behind a rolling shutter, against the pose at the middle row."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from slam_worlds import folded, in_sight, look

from facetcam.geometry import se3
from facetcam.slam.camera.optics import Optics
from facetcam.slam.config import SlamConfig
from facetcam.slam.map.map import Map
from facetcam.slam.map.measure import Measurements, Predictions
from facetcam.slam.tracking import tracker as tracker_module
from facetcam.slam.tracking.tracker import Tracker

OPTICS = Optics(folded(), 8.0)
READOUT = 0.02
VELOCITY = np.array([0.02, -0.05, 0.5, 0.05, 0.6, 0.0])  # half a radian and .6 m a second


def rolled(points: np.ndarray, T: np.ndarray) -> Measurements:
    """What a shutter that rolls sees: every point from where the rig is when its row is read."""
    sight = look(OPTICS, T, points)
    height = OPTICS.camera.height
    pixels = sight.pixels.copy()
    for _ in range(3):  # the row tells the time, and the time the row
        late = READOUT * (pixels[:, 1] - (height - 1) / 2.0) / (height - 1)
        for i, t in enumerate(late):
            seen = OPTICS.project(
                se3.transform(se3.inverse(T @ se3.exp(t * VELOCITY)), points[sight.point[i]][None])
            )
            pixels[i] = seen[0][sight.view[i], 0]
    return Measurements(sight.point, sight.view, pixels, OPTICS.plane(pixels, sight.view))


@pytest.mark.parametrize("known", [True, False])
def test_a_pose_is_that_of_the_middle_row_once_the_readout_is_known(
    monkeypatch: pytest.MonkeyPatch, known: bool
) -> None:
    T = se3.exp([0.01, 0.02, 0.3, 0.2, 0.1, 0.0])
    points = in_sight(OPTICS, T[None], np.random.default_rng(71), 150)
    seen = rolled(points, T)
    map = Map()
    map.points.extend(xyz=points)
    map.readout = READOUT if known else 0.0
    nothing = np.zeros((len(seen), 2))
    expected = Predictions(seen.point, seen.view, nothing, np.zeros((len(seen), 2, 2)))
    monkeypatch.setattr(tracker_module, "predict", lambda *_: expected)
    monkeypatch.setattr(tracker_module, "thin", lambda predictions, *_: predictions)
    monkeypatch.setattr(tracker_module, "measure", lambda *_: (seen, np.ones(len(seen), dtype=bool)))
    part = SimpleNamespace(blank=np.zeros(OPTICS.n_views, dtype=bool))
    tracker = Tracker(map, OPTICS, SlamConfig(), part, part)  # type: ignore[arg-type]
    fix = tracker.locate(part, T, np.arange(len(points)), VELOCITY)  # type: ignore[arg-type]
    assert fix is not None
    error = se3.log(se3.inverse(T) @ fix.T_world_rig)
    turn, way = np.linalg.norm(error.reshape(2, 3), axis=1)
    assert (np.degrees(turn) < 0.001 and way < 1e-4) if known else way > 0.002
