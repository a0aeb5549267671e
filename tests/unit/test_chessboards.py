"""Plain chessboards: found whole, cut, turned, mirrored, several at once; and not where there are none."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from facetcam.calibration.boards import Board, BoardSet
from facetcam.calibration.chessboards import detect_chessboards, placements
from facetcam.calibration.detection import detect

BOARD = Board("plain", "chessboard", (8, 7), 0.03)
CELL = 60  # pixels a square of the drawing


def drawing(board: Board) -> NDArray[np.uint8]:
    """The board with its white rim, upper left square black, one square of rim."""
    columns, rows = board.squares
    y, x = np.mgrid[0 : rows * CELL, 0 : columns * CELL] // CELL
    squares = np.where((x + y) % 2 == 0, 30, 220).astype(np.uint8)
    return np.pad(squares, CELL, constant_values=220)


def shown(board: Board, quads: list[list[list[float]]], seed: int = 0) -> tuple[np.ndarray, list[np.ndarray]]:
    """A noisy 1200 x 900 photo of boards whose outline (from the upper left, clockwise) is at the quads;
    and where the corners are."""
    photo = np.full((900, 1200), 110, dtype=np.uint8)
    columns, rows = board.squares
    corners = np.array([[0, 0], [columns, 0], [columns, rows], [0, rows]]) * CELL + CELL - 0.5
    truth = []
    for quad in quads:
        # Twice as large and shrunk: edges like those of a lens.
        H = cv2.getPerspectiveTransform(corners.astype(np.float32), np.array(quad, np.float32) * 2 + 0.5)
        image = cv2.warpPerspective(drawing(board), H, (2400, 1800), flags=cv2.INTER_AREA)
        there = cv2.warpPerspective(np.full_like(drawing(board), 255), H, (2400, 1800))
        image, there = (cv2.resize(i, (1200, 900), interpolation=cv2.INTER_AREA) for i in (image, there))
        photo = np.where(there > 254, image, photo)
        at = (board.points[:, :2] / board.square + 1) * CELL - 0.5
        truth.append((cv2.perspectiveTransform(at[None], H)[0] - 0.5) / 2)
    noise = np.random.default_rng(seed).normal(0, 2, photo.shape)
    return np.clip(cv2.GaussianBlur(photo, (0, 0), 0.8) + noise, 0, 255).astype(np.uint8), truth


DIRECT = [[100, 120], [420, 90], [450, 400], [80, 380]]
TURNED = [[1000, 760], [660, 800], [640, 520], [980, 500]]
MIRRORED = [[1100, 80], [760, 110], [740, 380], [1120, 410]]


def test_each_sighting_is_found_where_it_is() -> None:
    photo, truth = shown(BOARD, [DIRECT, TURNED, MIRRORED])
    found = detect(photo, BoardSet((BOARD,)), 4)
    assert [len(s) for s in found] == [42, 42, 42]
    assert all(s.photo == 4 and s.mirrored is None for s in found)
    for at, mirrored in zip(truth, (False, False, True)):
        sighting = min(found, key=lambda s: np.linalg.norm(s.pixels.mean(axis=0) - at.mean(axis=0)))
        (way,) = placements(sighting, BOARD, mirrored)
        assert np.linalg.norm(way.pixels - at[way.corners], axis=1).max() < 0.15
        (other,) = placements(sighting, BOARD, not mirrored)
        assert np.linalg.norm(other.pixels - at[other.corners], axis=1).max() > 30


@pytest.mark.parametrize(
    ("squares", "parity", "ways"),
    [((8, 7), None, 1), ((9, 7), None, 2), ((8, 6), True, 2), ((9, 9), None, 4)],
)
def test_what_the_pattern_can_tell(squares: tuple[int, int], parity: bool | None, ways: int) -> None:
    board = Board("b", "chessboard", squares, 0.03)
    photo, truth = shown(board, [MIRRORED])
    (sighting,) = detect_chessboards(photo, board, 0, 0)
    assert sighting.mirrored is parity
    read = placements(sighting, board, True)
    assert len(read) == ways
    assert min(np.abs(w.pixels - truth[0][w.corners]).max() for w in read) < 0.15
    assert len(placements(sighting, board, False)) == (0 if parity else ways)


def test_a_board_cut_by_a_seam_is_one_of_its_placements() -> None:
    photo, truth = shown(BOARD, [DIRECT])
    photo[:, 270:] = 60
    (sighting,) = detect_chessboards(photo, BOARD, 0, 0)
    assert 15 <= len(sighting) < 30
    ways = placements(sighting, BOARD, False)
    assert len(ways) > 1
    assert min(np.abs(w.pixels - truth[0][w.corners]).max() for w in ways) < 0.2


@pytest.mark.parametrize("seed", range(3))
def test_no_board_is_seen_in_texture(seed: int) -> None:
    rng = np.random.default_rng(seed)
    noise = cv2.resize(rng.integers(0, 255, (150, 200), dtype=np.uint8), (1200, 900))
    assert detect_chessboards(noise, BOARD, 0, 0) == []
    tiles = np.kron(rng.integers(0, 2, (60, 80), dtype=np.uint8) * 200, np.ones((15, 15), np.uint8))
    assert detect_chessboards(tiles, BOARD, 0, 0) == []


def test_another_board_is_not_taken_for_this_one() -> None:
    photo, _ = shown(Board("larger", "chessboard", (12, 9), 0.03), [DIRECT])
    assert all(len(s) < 42 for s in detect_chessboards(photo, BOARD, 0, 0))


def test_real_photos_show_the_board_directly_and_in_mirrors(shared_data: Path) -> None:
    """Photo 9 shows the board's back in the right mirror, photo 4 all four sightings."""
    folder = shared_data / "mirrors" / "two-mirror-table"
    sizes = {}
    for photo in (4, 9):
        grey = cv2.imread(str(folder / f"Image{photo}.jpg"), cv2.IMREAD_GRAYSCALE)
        sizes[photo] = [len(s) for s in detect_chessboards(grey, BOARD, 0, photo)]
    assert sizes[4][:3] == [42, 42, 42] and len(sizes[4]) == 4
    assert sizes[9] == [42, 42]
