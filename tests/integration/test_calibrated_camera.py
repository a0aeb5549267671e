"""A camera without mirrors, calibrated from photos of every kind of board, against the one that took them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from board_photos import seen, write_photos
from calibration_worlds import facing

from facetcam.calibration import Board, BoardSet
from facetcam.pipelines.calibrate import run_calibration
from facetcam.rig import Camera, Rig, View

SIZE = (960, 720)
CAMERA = Camera("brown-conrady", *SIZE, 830.0, 826.0, 470.0, 365.0, (0.0,) * 5)
K = np.array([[CAMERA.fx, 0, CAMERA.cx], [0, CAMERA.fy, CAMERA.cy], [0, 0, 1.0]])
UPRIGHT = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
BOARDS = [
    Board("marked", "charuco", (9, 7), 0.05, 0.037, "DICT_4X4_50"),
    Board("plain", "chessboard", (10, 7), 0.05),
    Board("tags", "aprilgrid", (6, 5), 0.078, 0.06, "DICT_APRILTAG_36h11"),
]


@pytest.mark.parametrize("board", BOARDS, ids=lambda board: board.kind)
def test_camera_from_photos(tmp_path: Path, board: Board) -> None:
    random = np.random.default_rng(4)
    images = []
    for k in range(6):
        sideways = np.array([*random.uniform(-0.15, 0.15, 2), 1.0])
        T = facing(board, np.zeros(3), sideways, 0.75 + 0.03 * k, random)
        images.append(seen(board, K, T, SIZE, k))
    drawn = Camera("brown-conrady", *SIZE, 900.0, 900.0, 479.5, 359.5, (0.0,) * 5)
    rig = Rig(drawn, UPRIGHT, {}, {"direct": View(())})
    photos = write_photos(tmp_path / "in", images)
    run = run_calibration(photos, BoardSet((board,)), tmp_path / "out", rig=rig, holdout=False)
    found, p = run.calibration.rig.camera, run.calibration.parameters
    assert run.calibration.rms() < 0.07
    assert run.calibration.fit.kept.mean() > 0.95  # what stands beside corners does not mislead
    off = np.array([found.fx - CAMERA.fx, found.fy - CAMERA.fy, found.cx - CAMERA.cx, found.cy - CAMERA.cy])
    assert np.all(np.abs(off) < (0.5, 0.5, 0.7, 0.7))
    assert np.all(np.abs(off) < 5.0 * p.sigma[:4])
