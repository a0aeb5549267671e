"""`facetcam boards`: files to print, and what cannot be printed."""

from __future__ import annotations

from pathlib import Path

import cv2
import pytest
from command import Facetcam, only_line

from facetcam.calibration import read_boards
from facetcam.calibration.detection import detect


def test_boards_to_print_are_those_of_their_file(facetcam: Facetcam, tmp_path: Path) -> None:
    out = tmp_path / "out"
    result = facetcam(
        "boards", "--count", 2, "--squares", "5x6", "--paper", "140x170", "--fixed", "--out", out
    )
    assert result.exit_code == 0, result.output
    boards = read_boards(out / "boards.yaml")
    assert boards.fixed
    assert [board.ids.start for board in boards.boards] == [0, 15]
    for index, board in enumerate(boards.boards):
        picture = cv2.imread(str(out / f"{board.name}.png"))
        (sighting,) = detect(picture, boards)
        assert sighting.board == index
        assert len(sighting) == len(board.points)
        # True to size: the PNG has 300 dots an inch.
        a, b = (sighting.pixels[list(sighting.corners).index(k)] for k in (0, 3))
        assert abs((b - a)[0] / 300 * 0.0254 - 3 * board.square) < 5e-5
        assert (out / f"{board.name}.pdf").read_bytes().startswith(b"%PDF")
    again = facetcam("boards", "--from", out / "boards.yaml", "--paper", "A4", "--out", tmp_path / "again")
    assert again.exit_code == 0, again.output
    assert read_boards(tmp_path / "again" / "boards.yaml") == boards


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--square-mm", 60], "do not fit on 210 x 297 mm"),
        (["--count", 40], "leave DICT_5X5_1000"),
        (["--square-mm", 20, "--marker-mm", 20], "must be shorter than the square"),
        (["--dictionary", "DICT_5X5_99"], "unknown dictionary"),
    ],
)
def test_boards_that_cannot_be(
    facetcam: Facetcam, tmp_path: Path, arguments: list[object], message: str
) -> None:
    assert message in only_line(facetcam("boards", *arguments, "--out", tmp_path / "out"))
    assert not (tmp_path / "out").exists()


def test_wrong_usage(facetcam: Facetcam, tmp_path: Path) -> None:
    assert facetcam("boards", "--paper", "B9", "--out", tmp_path / "out").exit_code == 2
