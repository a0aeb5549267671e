"""Boards and their files; OpenCV's own boards are the judge of where points and markers are."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from facetcam.calibration import Board, BoardSet, read_boards, write_boards
from facetcam.errors import ConfigError

NORTH = (
    "{name: north, type: charuco, dictionary: DICT_5X5_250, squares: [11, 8], square: 0.06, marker: 0.045}"
)


def charuco(name: str = "north", first_id: int = 0, squares: tuple[int, int] = (11, 8)) -> Board:
    return Board(name, "charuco", squares, 0.06, 0.045, "DICT_5X5_250", first_id)


@pytest.mark.parametrize("squares", [(11, 8), (5, 7), (4, 4), (3, 3), (6, 5)])
@pytest.mark.parametrize("legacy", [False, True])
def test_charuco_is_that_of_opencv(squares: tuple[int, int], legacy: bool) -> None:
    board = Board("b", "charuco", squares, 0.06, 0.045, "DICT_5X5_250", 3, legacy)
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_250)
    theirs = cv2.aruco.CharucoBoard(squares, 0.06, 0.045, dictionary, np.array(board.ids))
    theirs.setLegacyPattern(legacy)
    np.testing.assert_allclose(board.points, theirs.getChessboardCorners(), atol=1e-6)
    np.testing.assert_allclose(board.marker_corners, theirs.getObjPoints(), atol=1e-6)


def test_an_aprilgrid_counts_from_the_bottom() -> None:
    board = Board("b", "aprilgrid", (3, 2), 0.104, 0.08, "DICT_APRILTAG_36h11", 10)
    assert list(board.ids) == [10, 11, 12, 13, 14, 15]
    assert board.points.shape == (24, 3)
    np.testing.assert_allclose(board.marker_corners[0, 0], [0.024, 0.128, 0])  # id 10: lower left
    np.testing.assert_allclose(board.marker_corners[5, 2], [2 * 0.104 + 0.104, 0.104, 0])
    np.testing.assert_allclose(board.size, [3 * 0.104 + 0.024, 2 * 0.104 + 0.024])


def test_a_file_comes_back(tmp_path: Path) -> None:
    boards = BoardSet(
        (
            charuco(),
            charuco("south", 44),
            Board("plain", "chessboard", (8, 7), 1.0),
            Board("tags", "aprilgrid", (6, 6), 0.1, 0.08, "DICT_APRILTAG_36h11", border=2),
        ),
        fixed=True,
        note="walls",
    )
    write_boards(boards, tmp_path / "boards.yaml")
    assert read_boards(tmp_path / "boards.yaml") == boards
    with pytest.raises(ConfigError, match="exists already"):
        write_boards(boards, tmp_path / "boards.yaml")


def test_the_digest_knows_the_pattern_and_not_the_note() -> None:
    boards = BoardSet((charuco(),))
    assert BoardSet((charuco(),), fixed=True, note="x").digest == boards.digest
    assert BoardSet((charuco(first_id=1),)).digest != boards.digest


def test_boards_of_the_house(shared_data: Path) -> None:
    boards = read_boards(shared_data / "house" / "calibration" / "boards.yaml")
    assert boards.fixed
    assert [board.ids.start for board in boards.boards] == [0, 44, 88, 132]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("boards: []", "there is none"),
        (f"boards: [{NORTH}]\nfixd: true", "did you mean 'fixed'"),
        (f"boards: [{NORTH}, {NORTH}]", "two are named 'north'"),
        (f"boards: [{NORTH}, {NORTH.replace('north', 'south')}]", "give 'south' first_id: 44"),
        (f"boards: [{NORTH.replace('250', '50').replace('[11, 8]', '[11, 10]')}]", "ids 0 to 54 leave"),
        (f"boards: [{NORTH.replace('5X5_250', '5X5_25')}]", "did you mean 'DICT_5X5_250'"),
        (f"boards: [{NORTH.replace('0.045', '0.06')}]", "must be shorter than the square"),
        (f"boards: [{NORTH.replace('charuco', 'circles')}]", "is not one of 'charuco'"),
        (f"boards: [{NORTH.replace('charuco', 'chessboard')}]", "has no markers"),
        (f"boards: [{NORTH.replace('marker: 0.045', 'first_id: 3')}]", "needs 'marker'"),
        (f"boards: [{NORTH.replace('[11, 8]', '[2, 8]')}]", "must be 3 to 500"),
        ("boards: [{name: a, type: chessboard, squares: [8, 7], square: -1}]", "above zero"),
        ("boards: [{name: a, type: chessboard, squares: [8, 7], square: 60}]", "would be 480 m wide; give"),
        ("boards: [{name: a, type: chessboard, squares: [8, 7], square: 6e-5}]", "0.00048 m wide; give"),
        (f"boards: [{NORTH.replace('0.06', '60').replace('0.045', '45')}]", "square 60 is in metres"),
        ("boards: [{name: a, type: chessboard, squares: [8, 7]}]", "missing key 'square'"),
    ],
)
def test_files_that_cannot_be(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "boards.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        read_boards(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert message in str(caught.value)
