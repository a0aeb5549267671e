"""`facetcam evaluate detectors` on a small folder, and what it says on bad input."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from command import Facetcam, only_line


@pytest.fixture
def wall(tmp_path: Path) -> Path:
    """Three images of a textured plane that moves by whole pixels, in the Oxford layout."""
    rng = np.random.default_rng(0)
    plane = cv2.resize(rng.integers(0, 256, (60, 80), np.uint8), (320, 240), interpolation=cv2.INTER_CUBIC)
    folder = tmp_path / "wall"
    folder.mkdir()
    for index, shift in enumerate((0, 5, 11), start=1):
        cv2.imwrite(str(folder / f"img{index}.png"), np.roll(plane, shift, axis=1))
        if shift:
            np.savetxt(folder / f"H1to{index}p", [[1, 0, shift], [0, 1, 0], [0, 0, 1]])
    return folder


def test_tables_and_pictures(facetcam: Facetcam, wall: Path, tmp_path: Path) -> None:
    out = tmp_path / "scores"
    options = ("--protocols", "BD", "--top", "200", "-d", "SIICF", "--synthetic", "--format", "json")
    result = facetcam("evaluate", "detectors", str(wall), *options, "--out", str(out))
    assert result.exit_code == 0, result.output
    records = json.loads(result.stdout)
    of_wall = next(r for r in records if r["sequence"] == "wall" and r["detector"] == "SIICF")
    assert of_wall["scores"]["B"] > 0.95  # the picture only moves
    assert of_wall["scores"]["B px"] < 0.2
    assert {"wall", "noise", "scale 0.5"} <= {record["sequence"] for record in records}
    assert {p.name for p in out.iterdir()} == {f"scores.{e}" for e in ("txt", "csv", "json", "svg")} | {
        "corners.png"
    }
    lines = list(csv.reader((out / "scores.csv").read_text().splitlines()))
    assert lines[0] == ["sequence", "detector", "score", "value"]
    assert len(lines) == 1 + sum(len(record["scores"]) for record in records)
    assert cv2.imread(str(out / "corners.png")).shape == (480, 640, 3)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("-d", "SIFFT"), "unknown detector 'SIFFT'"),
        (("--protocols", "BX"), "protocols: expected letters of ABCD"),
        (("--out", "."), "exist"),
    ],
)
def test_wrong_options(facetcam: Facetcam, wall: Path, options: tuple[str, ...], message: str) -> None:
    result = facetcam("evaluate", "detectors", str(wall), *options)
    assert result.exit_code == 1
    assert message in only_line(result)


def test_wrong_folders(facetcam: Facetcam, wall: Path, tmp_path: Path) -> None:
    for path, message in ((tmp_path / "absent", "not a folder"), (tmp_path, "")):
        result = facetcam("evaluate", "detectors", str(path), "-d", "ORB")
        assert (result.exit_code == 1) == bool(message)
        if message:
            assert message in only_line(result)
    (wall / "img3.png").write_bytes(b"no image")
    result = facetcam("evaluate", "detectors", str(wall), "-d", "ORB")
    assert result.exit_code == 1
    assert "cannot be read as an image" in only_line(result)
