"""Boards found again in what is printed of them: every corner, plain, mirrored, several times, in parts."""

from __future__ import annotations

import io
from pathlib import Path

import cv2
import numpy as np
import pytest
from board_photos import photo
from numpy.typing import NDArray

from facetcam.calibration import Board, BoardSet
from facetcam.calibration import corners as module
from facetcam.calibration.corners import refine
from facetcam.calibration.detection import detect
from facetcam.calibration.markers import read_markers
from facetcam.viz.board_pages import PAGES, draw_board, place, to_bytes

DPI = 120
Image = NDArray[np.uint8]

CHARUCO = Board("c", "charuco", (7, 9), 0.027, 0.02, "DICT_4X4_50", 3)
GRID = Board("g", "aprilgrid", (5, 6), 0.032, 0.024, "DICT_APRILTAG_36h11", 7)
KALIBR = Board("k", "aprilgrid", (5, 6), 0.032, 0.024, "DICT_APRILTAG_36h11", 7, border=2)


def printed(board: Board) -> tuple[Image, NDArray[np.float64]]:
    """The PNG that is printed, and where its corners are in it, by the page's own measure."""
    page = place(board, PAGES["A4"])
    png = to_bytes(draw_board(board, page), "png", DPI)
    image = cv2.imdecode(np.frombuffer(io.BytesIO(png).getvalue(), np.uint8), cv2.IMREAD_GRAYSCALE)
    millimetres = 1000.0 * board.points[:, :2] + (page.left, page.top)
    corners = millimetres * DPI / 25.4 - 0.5
    corners[:, 1] += image.shape[0] - page.height * DPI / 25.4  # the page is drawn from its lower edge up
    return np.asarray(image, np.uint8), corners


@pytest.mark.parametrize("board", [CHARUCO, GRID, KALIBR], ids=lambda b: f"{b.kind}-{b.border}")
@pytest.mark.parametrize("mirrored", [False, True])
def test_every_printed_corner_is_found(board: Board, mirrored: bool) -> None:
    image, corners = printed(board)
    if mirrored:
        image, corners[:, 0] = cv2.flip(image, 1), image.shape[1] - 1 - corners[:, 0]
    (sighting,) = detect(image, BoardSet((board,)), photo=5)
    assert (sighting.photo, sighting.board, sighting.mirrored) == (5, 0, mirrored)
    assert sorted(sighting.corners) == list(range(len(board.points)))
    error = np.linalg.norm(sighting.pixels - corners[sighting.corners], axis=1)
    assert error.max() < 0.15


def test_tags_that_stand_on_their_heads() -> None:
    """As Kalibr prints them: the grid counts from the bottom, each tag turned by half a turn."""
    image, corners = printed(GRID)
    page = place(GRID, PAGES["A4"])
    turned = image.copy()
    for quad in GRID.marker_corners:
        (x0, y0), (x1, y1) = (
            ((1000.0 * quad[[0, 2], :2] + (page.left, page.top)) * DPI / 25.4).round().astype(int)
        )
        turned[y0:y1, x0:x1] = image[y0:y1, x0:x1][::-1, ::-1]
    (sighting,) = detect(turned, BoardSet((GRID,)))
    assert len(sighting) == len(GRID.points)
    assert np.linalg.norm(sighting.pixels - corners[sighting.corners], axis=1).max() < 1.0


def scene() -> tuple[Image, BoardSet, list[tuple[int, bool, NDArray[np.float64]]]]:
    """Two boards of one dictionary, one of them three times: twice plainly, once in a mirror, one cut off."""
    canvas = np.full((1000, 1500), 128, np.uint8)
    truth = []
    first = Board("a", "charuco", (6, 5), 0.03, 0.022, "DICT_4X4_50", 0)
    second = Board("b", "charuco", (5, 6), 0.03, 0.022, "DICT_4X4_50", 15)
    places = [
        (0, first, [[60, 70], [690, 40], [660, 500], [90, 540]]),
        (0, first, [[1400, 90], [820, 60], [850, 470], [1380, 520]]),  # mirrored: runs to the left
        (0, first, [[760, 600], [1330, 590], [1300, 1080], [740, 1050]]),  # leaves the photo
        (1, second, [[100, 590], [480, 570], [500, 980], [80, 960]]),
    ]
    for index, board, quad in places:
        image, corners = printed(board)
        page = place(board, PAGES["A4"])
        box = np.array([page.left, page.top]) + np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * 1000 * np.array(
            board.size
        )
        box = (box * DPI / 25.4 - 0.5).astype(np.float32)
        H = cv2.getPerspectiveTransform(box, np.array(quad, np.float32))
        margin = 10 * np.sign(box - box.mean(axis=0))
        inside = cv2.fillConvexPoly(np.zeros(image.shape, np.uint8), (box + margin).astype(int), 255)
        warped = cv2.warpPerspective(image, H, canvas.shape[::-1], flags=cv2.INTER_AREA)
        mask = cv2.warpPerspective(inside, H, canvas.shape[::-1], flags=cv2.INTER_NEAREST)
        canvas = np.where(mask > 0, warped, canvas).astype(np.uint8)
        truth.append((index, quad[0][0] > quad[1][0], cv2.perspectiveTransform(corners[None], H)[0]))
    noise = np.random.default_rng(0).normal(0.0, 2.0, canvas.shape)
    blurred = cv2.GaussianBlur(canvas, (0, 0), 0.8)
    return np.clip(blurred * 0.7 + 30 + noise, 0, 255).astype(np.uint8), BoardSet((first, second)), truth


def test_boards_seen_several_times_directly_and_in_mirrors() -> None:
    image, boards, truth = scene()
    sightings = detect(image, boards)
    assert len(sightings) == len(truth)
    for board, mirrored, corners in truth:
        (match,) = [
            s
            for s in sightings
            if s.board == board and np.median(np.linalg.norm(s.pixels - corners[s.corners], axis=1)) < 1.0
        ]
        assert match.mirrored is mirrored
        inside = np.all((corners > 12) & (corners < np.array(image.shape[::-1]) - 13), axis=1)
        assert len(match) >= 0.85 * inside.sum()
        assert np.linalg.norm(match.pixels - corners[match.corners], axis=1).max() < 0.35


def test_no_board_in_other_pictures(shared_data: Path) -> None:
    boards = BoardSet((Board("a", "charuco", (6, 5), 0.03, 0.022, "DICT_4X4_50"),))
    noise = np.random.default_rng(1).integers(0, 256, (400, 600), dtype=np.uint8)
    assert detect(noise, boards) == []
    assert detect(np.zeros((400, 600, 3), np.uint16), boards) == []
    for name in ("leuven", "graf"):
        picture = cv2.imread(str(sorted((shared_data / "oxford" / name).glob("img1.*"))[0]))
        assert detect(picture, boards) == []


def test_a_wide_and_a_deep_photo() -> None:
    image, boards, _ = scene()
    deep = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR).astype(np.uint16) * 200
    assert len(detect(deep, boards)) == len(detect(image, boards))


def test_a_corner_cut_by_a_seam_is_refused() -> None:
    image, corners = printed(CHARUCO)
    corner = corners[len(corners) // 2]
    square = 0.027 * DPI / 0.0254
    pixels, accepted = refine(image, corner + np.array([0.8, -0.7]), square)
    assert accepted.all()
    assert np.linalg.norm(pixels - corner) < 0.1
    seam = image.copy()
    seam[:, int(corner[0]) + 2 :] = 0
    assert not refine(seam, corner, square)[1].any()
    assert not refine(image, [[1e9, np.nan], [-5.0, 3.0]], square)[1].any()


def test_a_prediction_that_comes_back_untouched_is_not_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    image, corners = printed(CHARUCO)
    corner, square = corners[len(corners) // 2], 0.027 * DPI / 0.0254
    monkeypatch.setattr(module, "fit_saddles", lambda image, start, *sizes: np.full_like(start, np.nan))
    assert refine(image, corner + np.array([0.8, -0.7]), square)[1].all()
    monkeypatch.setattr(cv2, "cornerSubPix", lambda image, corners, *settings: corners)
    assert not refine(image, corner, square)[1].any()


@pytest.mark.parametrize("mirrored", [False, True])
def test_codes_of_other_boards_change_nothing(mirrored: bool) -> None:
    board = Board("far", "charuco", (6, 5), 0.03, 0.022, "DICT_5X5_250", first_id=100)
    image = cv2.flip(photo(board), 1) if mirrored else photo(board)
    everything = read_markers(image, board, mirrored)
    few = read_markers(image, board, mirrored, np.array(board.ids))
    assert len(few.ids) == len(board.ids)
    np.testing.assert_array_equal(np.sort(everything.ids), np.array(board.ids))
    np.testing.assert_array_equal(few.ids, everything.ids)
    np.testing.assert_array_equal(few.quads, everything.quads)
    assert not len(read_markers(image, board, mirrored, np.arange(100)).ids)
