"""`facetcam evaluate detectors` on a small folder, and what it says on bad input."""

from __future__ import annotations

import csv
import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from command import Facetcam, only_line

from facetcam.errors import SourceError
from facetcam.evaluation.datasets import read_grey
from facetcam.evaluation.peers import peers
from facetcam.pipelines.detectors import contact_sheet, run_detectors
from facetcam.viz.pictures import CAPTION_HEIGHT


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
        "corners.png",
        "report.html",
    }
    lines = list(csv.reader((out / "scores.csv").read_text().splitlines()))
    assert lines[0] == ["sequence", "detector", "score", "value"]
    assert len(lines) == 1 + sum(len(record["scores"]) for record in records)
    framed = (240 + CAPTION_HEIGHT + 6, 320 + 12)
    assert cv2.imread(str(out / "corners.png")).shape == (2 * framed[0], 2 * framed[1], 3)


def test_the_sheet_shows_corners_of_the_original_alone(wall: Path) -> None:
    image = np.maximum(read_grey(wall / "img1.png"), 1)
    original, smaller, turned, sheared = contact_sheet(image, peers(["SIICF all"])["SIICF all"])
    assert original.image.all() and len(original.points) == len(smaller.points) == 200
    centre = np.array([159.5, 119.5])
    assert (np.abs(smaller.points - centre) <= 0.7 * centre).all()
    for picture in (smaller, turned, sheared):
        assert not picture.image[:2, :2].any()
        x, y = np.rint(picture.points).astype(int).T
        assert np.asarray(picture.image)[y, x].all()


def test_image_files_are_changed(facetcam: Facetcam, wall: Path) -> None:
    result = facetcam("evaluate", "detectors", str(wall / "img1.png"), "-d", "ORB", "--protocols", "B")
    assert result.exit_code == 0, result.output
    assert "rotation 30" in result.stdout
    assert "wall" not in result.stdout


def test_images_without_a_corner_score_nothing(facetcam: Facetcam, tmp_path: Path) -> None:
    folder = tmp_path / "flat"
    folder.mkdir()
    for index in (1, 2):
        cv2.imwrite(str(folder / f"{index}.png"), np.full((240, 320), 90, np.uint8))
    options = ("--protocols", "ABCD", "-d", "SIICF", "-d", "ORB", "-d", "SIFT", "-d", "GFTT")
    out = tmp_path / "scores"
    result = facetcam("evaluate", "detectors", str(folder), *options, "--format", "json", "--out", str(out))
    assert result.exit_code == 0, result.output
    for record in json.loads(result.stdout):
        assert record["scores"]["B"] == record["scores"]["D MMA@3"] == 0.0
        assert record["scores"]["B px"] is None
    assert (out / "report.html").exists()


def test_a_run_cut_short_keeps_what_it_has(wall: Path, tmp_path: Path) -> None:
    def stop(done: int, total: int | None) -> None:
        assert total == 3
        if done == 2:
            raise KeyboardInterrupt

    out = tmp_path / "scores"
    with pytest.raises(KeyboardInterrupt):
        run_detectors([wall], out, names=["ORB", "GFTT", "FAST"], protocols="B", progress=stop)
    kept = {line["detector"] for line in csv.DictReader((out / "scores.csv").read_text().splitlines())}
    assert kept == {"ORB", "GFTT"}
    assert "Interrupted (stopped by the user)" in (out / "report.html").read_text()


def test_sets_of_one_name_are_told_apart(wall: Path, tmp_path: Path) -> None:
    other = tmp_path / "other" / "wall"
    shutil.copytree(wall, other)
    tables = run_detectors([wall, other], names=["ORB"], protocols="B")
    names = [record["sequence"] for record in json.loads(tables["json"])]
    assert names == [str(wall), str(other)]
    with pytest.raises(SourceError, match="given twice"):
        run_detectors([wall, wall], names=["ORB"])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("-d", "SIFFT"), "unknown detector 'SIFFT'; did you mean 'SIFT'"),
        (("--protocols", "BX"), "protocols: expected letters of ABCD"),
        (("--protocols", "BB"), "protocols: expected letters of ABCD"),
        (("--out", "."), "exist"),
    ],
)
def test_wrong_options(facetcam: Facetcam, wall: Path, options: tuple[str, ...], message: str) -> None:
    result = facetcam("evaluate", "detectors", str(wall), *options)
    assert result.exit_code == 1
    assert message in only_line(result)


def test_wrong_folders(facetcam: Facetcam, wall: Path, tmp_path: Path) -> None:
    for path, message in ((tmp_path / "absent", "does not exist"), (tmp_path, "")):
        result = facetcam("evaluate", "detectors", str(path), "-d", "ORB")
        assert (result.exit_code == 1) == bool(message)
        if message:
            assert message in only_line(result)
    (wall / "img3.png").write_bytes(b"no image")
    result = facetcam("evaluate", "detectors", str(wall), "-d", "ORB")
    assert result.exit_code == 1
    assert "cannot be read as an image" in only_line(result)
