"""`facetcam calibrate --hand-mirror`: photos of a board in a mirror at known places, and what is refused."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from board_photos import seen, write_photos
from command import Facetcam, only_line
from numpy.typing import NDArray

from facetcam.calibration import Board, BoardSet, write_boards
from facetcam.geometry import se3

Array = NDArray[np.float64]

BOARD = Board("wall", "charuco", (8, 6), 0.06, 0.045, "DICT_5X5_250")
SIZE, FOCAL = (960, 720), 830.0
K = np.array([[FOCAL, 0.0, 480.0], [0.0, FOCAL, 360.0], [0.0, 0.0, 1.0]])
# The board hangs behind the camera and to its left, and looks the way the camera does.
T_CAM_BOARD = se3.exp(np.array([0.1, -0.15, 0.05, 0.0, 0.0, 0.0])) @ np.array(
    [[-1.0, 0, 0, 0.1], [0, 1, 0, -0.25], [0, 0, -1, -0.3], [0, 0, 0, 1]]
)
TURNS = ((0.1, 0.08), (-0.12, 0.14), (0.16, -0.1), (-0.08, -0.16), (0.02, 0.2))


def in_mirror(
    turn: tuple[float, float] | None, seed: int, T_cam_board: Array = T_CAM_BOARD
) -> NDArray[np.uint8]:
    """A photo of the board in a mirror 0.45 m away turned about x and y; None for one without mirror."""
    T = T_cam_board
    if turn is None:
        T = se3.from_rotation_translation(np.eye(3), np.array([-0.2, -0.2, 1.0]))
    else:
        normal = se3.exp(np.array([*turn, 0.0, 0.0, 0.0, 0.0]))[:3, 2]
        reflection = np.eye(4)
        reflection[:3, :3] -= 2 * np.outer(normal, normal)
        reflection[:3, 3] = 2 * 0.45 * normal
        T = reflection @ T
    return seen(BOARD, K, T, SIZE, seed)


@pytest.fixture
def known(tmp_path: Path) -> tuple[object, ...]:
    """Options for the board and the camera."""
    write_boards(BoardSet((BOARD,)), tmp_path / "boards.yaml")
    file = cv2.FileStorage(str(tmp_path / "camera.yaml"), cv2.FILE_STORAGE_WRITE)
    for name, value in (("image_width", SIZE[0]), ("image_height", SIZE[1])):
        file.write(name, value)
    file.write("camera_matrix", K)
    file.write("distortion_coefficients", np.zeros((1, 5)))
    file.release()
    cache = ("--cache", tmp_path / "cache", "--out", tmp_path / "out", "--hand-mirror")
    return ("--boards", tmp_path / "boards.yaml", "--camera", tmp_path / "camera.yaml", *cache)


def test_the_board_is_where_it_hangs(facetcam: Facetcam, tmp_path: Path, known: tuple[object, ...]) -> None:
    images = [in_mirror(turn, k) for k, turn in enumerate(TURNS)]
    photos = write_photos(tmp_path / "in", [*images, in_mirror(None, 9)])
    result = facetcam("calibrate", photos, *known)
    assert result.exit_code == 0, result.output
    assert "seen directly, not in a mirror: 05.png" in result.output
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    off = np.array(summary["T_cam_board"]) @ se3.inverse(T_CAM_BOARD)
    turned = np.degrees(np.linalg.norm(se3.log(off)[:3]))
    middle = se3.transform(T_CAM_BOARD, np.array([[*BOARD.size, 0.0]]) / 2)
    moved = 1000 * np.linalg.norm(se3.transform(off, middle) - middle)
    assert turned < 0.1
    assert moved < 1.5
    assert turned < 4 * summary["sigma_deg"]
    assert moved < 4 * summary["sigma_mm"]
    assert 0.01 < summary["rms"] < 0.15
    assert len(summary["photos"]) == len(TURNS)
    assert not summary["warnings"][1:]
    with (tmp_path / "out" / "residuals.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["kept"] == "1"]
    rms = np.sqrt(np.mean([float(r["du"]) ** 2 + float(r["dv"]) ** 2 for r in rows]))
    assert abs(rms - summary["rms"]) < 1e-3
    assert "Residuals of each pose" in (tmp_path / "out" / "report.html").read_text()


def test_a_board_that_moved_is_noticed(facetcam: Facetcam, tmp_path: Path, known: tuple[object, ...]) -> None:
    images = [in_mirror(turn, k) for k, turn in enumerate(TURNS)]
    images[2] = in_mirror(
        TURNS[2], 2, se3.exp(np.array([0.0, 0.0, np.radians(3.0), 0.0, 0.0, 0.0])) @ T_CAM_BOARD
    )
    result = facetcam("calibrate", write_photos(tmp_path / "in", images), *known)
    assert result.exit_code == 0, result.output
    assert "no fixed board explains the photos" in " ".join(result.output.split())


def test_what_cannot_be_used(facetcam: Facetcam, tmp_path: Path, known: tuple[object, ...]) -> None:
    photos = write_photos(tmp_path / "in", [in_mirror(turn, k) for k, turn in enumerate(TURNS[:2])])

    def line(*arguments: object) -> str:
        return only_line(facetcam("calibrate", *arguments))

    assert "three" in line(photos, *known)
    direct = write_photos(tmp_path / "direct", [in_mirror(None, 0)])
    assert "all photos show the board directly" in line(direct, *known)
    two = BoardSet((BOARD, Board("other", "charuco", (5, 4), 0.06, 0.045, "DICT_5X5_250", 24)))
    write_boards(two, tmp_path / "two.yaml")
    assert "describes 2 boards" in line(photos, "--boards", tmp_path / "two.yaml", *known[2:])
    needs = facetcam("calibrate", photos, *known[:2], *known[4:])
    assert needs.exit_code == 2
    assert "needs --camera" in needs.output
    assert facetcam("calibrate", photos, *known, "--check").exit_code == 2
    assert not (tmp_path / "out").exists()
