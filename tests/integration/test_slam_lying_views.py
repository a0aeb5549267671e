"""The film of the house with a view that lies: frozen, or full of a person who walks about."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from facetcam.evaluation.trajectory import evaluate
from facetcam.io.odometry import read_odometry
from facetcam.io.sources import open_source
from facetcam.io.trajectories import read_tum
from facetcam.rig import Rig
from facetcam.slam import Slam, Status

pytestmark = pytest.mark.slow

Image = NDArray[np.uint8]
Spoil = Callable[[int, Image, Image, NDArray[np.bool_]], Image]

FRAMES = 150
STEPS = 40  # frames from one edge of the view to the other


def frozen(k: int, image: Image, first: Image, view: NDArray[np.bool_]) -> Image:
    return np.where(view, first, image)


def person(share: float, enter: int = 0) -> Spoil:
    small = np.random.default_rng(71).integers(0, 256, (150, 200), dtype=np.uint8)

    def spoil(k: int, image: Image, first: Image, view: NDArray[np.bool_]) -> Image:
        if k < enter:
            return image
        columns = np.flatnonzero(view.any(axis=0))
        width = int(share * len(columns))
        x = columns[0] + int(abs((k / STEPS) % 2.0 - 1.0) * (len(columns) - width))
        hidden = view & (np.arange(view.shape[1]) >= x) & (np.arange(view.shape[1]) < x + width)
        return np.where(hidden, np.roll(cv2.resize(small, view.shape[::-1]), x, axis=1), image)

    return spoil


@pytest.mark.parametrize(
    ("view", "spoil", "with_wheels"),
    [
        ("front", person(0.3), False),
        ("right", person(0.6), True),
        ("right", frozen, True),
        ("front", frozen, False),
        ("back", person(0.8, enter=60), False),
    ],
    ids=["person", "person + wheels", "frozen + wheels", "frozen", "late person"],
)
def test_one_view_that_lies_bends_no_path(
    shared_data: Path, view: str, spoil: Spoil, with_wheels: bool
) -> None:
    house = shared_data / "house"
    rig, wheels = Rig.load(house / "rig_true.yaml"), read_odometry(house / "loop_odometry.csv")
    rows = rig.labels() == list(rig.view_names).index(view)
    slam, states = Slam(rig), []
    with open_source(house / "loop.mp4", None) as film:
        first = None
        for k, frame in zip(range(FRAMES), film):
            grey = cv2.cvtColor(frame.image, cv2.COLOR_BGR2GRAY)
            first = grey if first is None else first
            odometry = wheels.at(frame.timestamp) if with_wheels else None
            states.append(slam.track(spoil(k, grey, first, rows), frame.timestamp, odometry))
    slam.finish()
    assert all(state.status is Status.TRACKING for state in states[60:])
    errors = evaluate(slam.trajectory(), read_tum(house / "loop.tum"), 0.02)
    assert errors.ate_scaled.rmse < 0.02
    assert errors.matched > 90
    assert not slam.metric or abs(errors.scale_error) < 3.0 * slam.scale_sigma
