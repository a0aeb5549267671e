"""`facetcam calibrate`: what it writes, and how it refuses what cannot be used."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
import pytest
from board_photos import BOARD, SIZE, photo, write_photos
from command import Facetcam, only_line

import facetcam as package
from facetcam.calibration import BoardSet, write_boards
from facetcam.pipelines.calibrate import run_calibration
from facetcam.rig import Camera, Rig

CAMERA = Camera("brown-conrady", *SIZE, 600.0, 600.0, 319.5, 239.5, (0.0,) * 5)
UPRIGHT = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])


@pytest.fixture
def boards(tmp_path: Path) -> Path:
    write_boards(BoardSet((BOARD,)), tmp_path / "boards.yaml")
    return tmp_path / "boards.yaml"


@pytest.fixture
def nominal(tmp_path: Path) -> Path:
    Rig(CAMERA, UPRIGHT).save(tmp_path / "nominal.yaml")
    return tmp_path / "nominal.yaml"


def test_what_cannot_be_used(facetcam: Facetcam, tmp_path: Path, boards: Path, nominal: Path) -> None:
    out = tmp_path / "out"
    photos = write_photos(tmp_path / "in", [photo(seed=k) for k in range(2)])

    def line(images: Path, *more: object) -> str:
        cache = tmp_path / "cache"
        return only_line(facetcam("calibrate", images, "--cache", cache, "--out", out, *more))

    both = ("--boards", boards, "--rig", nominal)
    assert "no such folder" in line(tmp_path / "x", *both)
    assert "boards.yaml: cannot be read" in line(photos, "--boards", tmp_path / "no" / "boards.yaml")
    assert "cannot be read" in line(photos, "--boards", boards, "--rig", tmp_path / "no.yaml")
    assert "neither an OpenCV camera" in line(photos, *both, "--camera", boards)
    assert "only with a rig as drawn" in line(photos, "--boards", boards, "--camera", boards)
    small = write_photos(tmp_path / "small", [photo(size=(320, 240))])
    assert "they are 320x240, but the camera of the rig is 640x480" in line(small, *both)
    still = write_photos(tmp_path / "still", [photo(), np.maximum(photo(), 21)])
    assert "show the boards in the same places" in line(still, *both)
    assert not out.exists()
    blank = write_photos(tmp_path / "blank", [np.full(SIZE[::-1], 90, np.uint8)])
    for _ in range(2):  # a failed try leaves the name free for the next
        assert "no board found in 1 photo;" in line(blank, *both)
        assert not out.exists()
    assert (tmp_path / "out-what-was-seen.jpg").exists()
    soft = write_photos(tmp_path / "soft", [cv2.GaussianBlur(photo(), (0, 0), 6.0)])
    assert re.search(r"the photos are blurred, edges are \d\.\d px wide at best", line(soft, *both))
    for where in (out, out / "seen"):
        assert "name another --cache" in line(photos, *both, "--cache", where)
        assert not out.exists()
    assert f"(Not a directory: {photos / '00.png'})" in line(
        photos, *both, "--out", photos / "00.png" / "out"
    )
    lone = write_photos(tmp_path / "lone", [photo()])
    for name in ("01.png", "02.png"):
        (lone / name).write_bytes((lone / "00.png").read_bytes())
    said = line(lone, *both)
    assert "only one photo shows a board" in said
    assert "2 of 3 photos left out, the same file as another photo: 01.png, 02.png" in said
    out.mkdir()
    (out / "rig.yaml").write_text("precious")
    assert "exists already" in line(photos, *both)
    assert "precious" in (out / "rig.yaml").read_text()


@pytest.mark.parametrize("during", ["looking for boards", "solving"])
def test_a_stopped_run_keeps_what_it_found(tmp_path: Path, boards: Path, nominal: Path, during: str) -> None:
    photos = write_photos(tmp_path / "in", [photo(seed=k) for k in range(3)])

    @contextmanager
    def impatient(name: str) -> Iterator[Callable[[int, int | None], None]]:
        def stop(done: int, total: int | None) -> None:
            if name == during:
                raise KeyboardInterrupt

        yield stop

    with pytest.raises(KeyboardInterrupt) as caught:
        run_calibration(
            photos, boards, tmp_path / "out", rig=nominal, cache=tmp_path / "cache", stage=impatient
        )
    assert "kept" in caught.value.__notes__[0]
    assert not (tmp_path / "out").exists()
    assert list((tmp_path / "cache").iterdir())


def test_a_run_stopped_while_it_is_judged_has_its_rig(tmp_path: Path, boards: Path, nominal: Path) -> None:
    photos = write_photos(tmp_path / "in", [photo(seed=k) for k in range(4)])

    @contextmanager
    def impatient(name: str) -> Iterator[Callable[[int, int | None], None]]:
        if name == "judging":
            raise KeyboardInterrupt
        yield lambda done, total: None

    with pytest.raises(KeyboardInterrupt) as caught:
        run_calibration(
            photos, boards, tmp_path / "out", rig=nominal, cache=tmp_path / "cache", stage=impatient
        )
    assert "the results so far are in" in caught.value.__notes__[0]
    assert {p.name for p in (tmp_path / "out").iterdir()} == {
        "rig.yaml",
        "summary.json",
        "residuals.csv",
        "export",
    }
    assert Rig.load(tmp_path / "out" / "rig.yaml").covariance is not None
    assert "cut short" in json.loads((tmp_path / "out" / "summary.json").read_text())["warnings"][-1]


@pytest.mark.slow
def test_ten_photos_of_the_house(facetcam: Facetcam, shared_data: Path, tmp_path: Path) -> None:
    house = shared_data / "house"
    folder = tmp_path / "in"
    folder.mkdir()
    for k in range(0, 30, 3):
        (folder / f"{k:05d}.jpg").symlink_to(house / "calibration" / f"{k:05d}.jpg")
    boards = house / "calibration" / "boards.yaml"
    arguments = ("--boards", boards, "--rig", house / "rig_nominal.yaml", "--cache", tmp_path / "cache")
    out = tmp_path / "out"
    result = facetcam("calibrate", folder, *arguments, "--out", out)
    assert result.exit_code == 0, result.output
    solved, true = Rig.load(out / "rig.yaml"), Rig.load(house / "rig_true.yaml")
    assert abs(solved.camera.fx / true.camera.fx - 1) < 5e-4
    summary = json.loads((out / "summary.json").read_text())
    assert summary["photos"] == 10
    with (out / "residuals.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == summary["corners"]
    kept = [np.hypot(float(r["du"]), float(r["dv"])) for r in rows if r["kept"] == "1"]
    assert abs(np.sqrt(np.mean(np.square(kept))) - summary["rms"]) < 1e-3
    page = (out / "report.html").read_text()
    assert "Residuals of each view" in page
    assert (out / "export" / "camchain.yaml").exists()
    assert summary["held_out_rms"] < 0.08
    check = facetcam("calibrate", folder, *arguments, "--check", "--out", tmp_path / "check")
    assert check.exit_code == 0, check.output
    assert "enough" in check.output
    assert not (tmp_path / "check").exists()
    in_memory = package.calibrate(sorted(folder.iterdir()), boards, house / "rig_nominal.yaml")
    assert abs(in_memory.rig.camera.fx - solved.camera.fx) < 1e-6
