"""`facetcam unwrap`: its pictures, its manners with bad input, and what is left when it is cut short."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from command import Facetcam, only_line
from films import moving, textured, write_film, write_folder

from facetcam.pipelines import run_unwrap

SAME_FOV = 2 * math.atan(32 / 60)  # of the rig's own camera: 64 pixels wide, focal length 60


def pixels(path: Path) -> np.ndarray:
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image is not None, path
    return image


def test_a_view_like_the_camera_itself_shows_the_same_pixels(
    facetcam: Facetcam, rig: Path, tmp_path: Path
) -> None:
    images, out = moving(3), tmp_path / "out"
    folder = write_folder(tmp_path / "in", images)
    result = facetcam(
        "unwrap", folder, "--rig", rig, "--size", "64x48", "--fov", math.degrees(SAME_FOV), "--out", out
    )
    assert result.exit_code == 0, result.output
    assert sorted(path.name for path in out.iterdir()) == ["front", "report.html", "views.yaml"]
    assert len(list((out / "front").iterdir())) == 3
    for k, image in enumerate(images):
        inner = np.s_[4:-4, 4:-4]
        assert np.abs(pixels(out / "front" / f"{k:06d}.png")[inner].astype(int) - image[inner]).max() <= 1
    view = yaml.safe_load((out / "views.yaml").read_text())["front"]
    assert (view["width"], view["height"], view["flipped"]) == (64, 48, False)
    assert (view["fx"], view["cx"], view["cy"]) == pytest.approx((60, 31.5, 23.5))
    np.testing.assert_allclose(
        view["T_rig_view"], [[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]], atol=1e-6
    )


def test_depth_stays(facetcam: Facetcam, rig: Path, tmp_path: Path) -> None:
    deep = np.random.default_rng(0).integers(0, 65536, (48, 64), dtype=np.uint16)
    folder = write_folder(tmp_path / "in", [deep])
    run_unwrap(folder, rig, tmp_path / "out", size=(64, 48), fov=SAME_FOV)
    picture = pixels(tmp_path / "out" / "front" / "000000.png")
    assert picture.dtype == np.uint16
    assert np.abs(picture[4:-4, 4:-4].astype(int) - deep[4:-4, 4:-4]).max() <= 1


def test_a_panorama_on_request(facetcam: Facetcam, film: Path, rig: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    result = facetcam("unwrap", film, "--rig", rig, "--panorama", 2, "--max-frames", 2, "--out", out)
    assert result.exit_code == 0, result.output
    assert len(list((out / "front").iterdir())) == 2
    panorama = pixels(out / "panorama" / "000001.png")
    assert panorama.shape[1] > panorama.shape[0]
    assert panorama.std() > 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--view", "fromt"], "did you mean 'front'?"),
        (["--fov", 180], "fov"),
        (["--size", "1x1"], "size: 1x1"),
        (["--panorama", -1], "must be positive"),
    ],
)
def test_impossible_wishes(
    facetcam: Facetcam, film: Path, rig: Path, tmp_path: Path, arguments: list[object], message: str
) -> None:
    line = only_line(facetcam("unwrap", film, "--rig", rig, *arguments, "--out", tmp_path / "out"))
    assert message in line
    assert not (tmp_path / "out").exists()


def test_wrong_usage(facetcam: Facetcam, film: Path, rig: Path, tmp_path: Path) -> None:
    assert facetcam("unwrap", film, "--rig", rig, "--size", "640").exit_code == 2


def test_bad_input(facetcam: Facetcam, film: Path, rig: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert "no such file" in only_line(facetcam("unwrap", tmp_path / "x.mp4", "--rig", rig, "--out", out))
    big = write_film(tmp_path / "big.mp4", [textured(96, 128)] * 3)
    assert "frames are 128x96" in only_line(facetcam("unwrap", big, "--rig", rig, "--out", out))
    assert not out.exists()
    out.mkdir()
    assert "exists already" in only_line(facetcam("unwrap", film, "--rig", rig, "--out", out))


def test_a_view_whose_name_leaves_the_folder(
    facetcam: Facetcam, film: Path, rig: Path, tmp_path: Path
) -> None:
    rig.write_text(rig.read_text().replace("front:", "../front:"))
    line = only_line(facetcam("unwrap", film, "--rig", rig, "--out", tmp_path / "out"))
    assert "'../front'" in line
    assert not (tmp_path / "front").exists()


def test_an_image_of_another_size_amid_the_film(facetcam: Facetcam, rig: Path, tmp_path: Path) -> None:
    folder, out = write_folder(tmp_path / "in", [*moving(3), textured(20, 30)]), tmp_path / "out"
    line = only_line(facetcam("unwrap", folder, "--rig", rig, "--out", out))
    assert "3.png: 30x20" in line
    assert f"the results so far are in {out}" in line
    assert len(list((out / "front").iterdir())) == 3
    assert "Interrupted" in (out / "report.html").read_text()
