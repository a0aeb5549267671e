"""Exports read back by the libraries they are for; intrinsics of other tools read."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pycolmap
import pytest
import yaml
from numpy.typing import NDArray

from facetcam.errors import SourceError
from facetcam.geometry import se3
from facetcam.io.intrinsics import read_intrinsics
from facetcam.io.virtual_cameras import colmap_camera, export_cameras
from facetcam.rig import Camera, Rig, View

BROWN = ("brown-conrady", (-0.21, 0.09, 1.2e-3, -7e-4, 0.013))
PLAIN = ("brown-conrady", (-0.21, 0.09, 1.2e-3, -7e-4, 0.0))
FISHEYE = ("kannala-brandt", (0.02, -0.01, 0.004, -0.001))


def rig_with(lens: tuple[str, tuple[float, ...]]) -> Rig:
    """The pyramid: one direct reflection a view, so that every view is flipped."""
    drawn = Rig.load("preset:pyramid")
    c = drawn.camera
    camera = Camera(lens[0], c.width, c.height, c.fx, c.fy + 1.5, c.cx + 3, c.cy - 2, lens[1])
    return Rig(camera, drawn.T_rig_cam, drawn.mirrors, {**drawn.views})


def seen(rig: Rig, view: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points of the rig frame and where they are on the view's proper (flipped) image, by the rig itself."""
    rng = np.random.default_rng(3)
    inside = np.argwhere(rig.labels() == rig.view_names.index(view))[:, ::-1].astype(float)
    raw = inside[rng.choice(len(inside), 60, replace=False)]
    origins, directions = rig.ray(view, raw)
    points = origins + rng.uniform(0.5, 5.0, (60, 1)) * directions
    pixels, _ = rig.project(view, points)
    if rig.is_flipped(view):
        pixels[:, 0] = rig.camera.width - 1 - pixels[:, 0]
    return points, pixels


@pytest.mark.parametrize("lens", [BROWN, FISHEYE], ids=["brown", "fisheye"])
def test_opencv_projects_as_the_rig_does(tmp_path: Path, lens: tuple[str, tuple[float, ...]]) -> None:
    rig = rig_with(lens)
    export_cameras(rig, tmp_path / "export")
    for name in rig.view_names:
        path = tmp_path / "export" / "opencv" / f"{name}.yaml"
        file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
        K, D = (file.getNode(key).mat() for key in ("camera_matrix", "distortion_coefficients"))
        T = se3.inverse(file.getNode("T_rig_view").mat())
        points, pixels = seen(rig, name)
        project = cv2.fisheye.projectPoints if file.getNode("fisheye_model").real() else cv2.projectPoints
        rvec = cv2.Rodrigues(T[:3, :3])[0]
        theirs = project(points[:, None], rvec, T[:3, 3].copy(), K, D)[0].reshape(-1, 2)
        np.testing.assert_allclose(theirs, pixels, atol=1e-6)
        assert bool(file.getNode("flipped").real()) is rig.is_flipped(name)
        assert read_intrinsics(path) == rig.view_camera(name)


@pytest.mark.parametrize("lens", [BROWN, FISHEYE], ids=["brown", "fisheye"])
def test_colmap_projects_as_the_rig_does(tmp_path: Path, lens: tuple[str, tuple[float, ...]]) -> None:
    rig = rig_with(lens)
    export_cameras(rig, tmp_path / "export")
    (config,) = pycolmap.read_rig_config(tmp_path / "export" / "colmap" / "rig_config.json")
    first = rig.T_rig_view(rig.view_names[0])
    for name, entry in zip(rig.view_names, config.cameras, strict=True):
        assert entry.image_prefix == f"{name}/"
        points, pixels = seen(rig, name)
        in_first = se3.transform(se3.inverse(first), points)
        moved = in_first if entry.ref_sensor else np.array([entry.cam_from_rig * p for p in in_first])
        theirs = np.array([entry.camera.img_from_cam(p) for p in moved]).reshape(-1, 2)
        np.testing.assert_allclose(theirs - 0.5, pixels, atol=1e-6)


@pytest.mark.parametrize("lens", [BROWN, PLAIN, FISHEYE], ids=["k3", "plain", "fisheye"])
def test_kalibr_camchain_projects_as_the_rig_does(
    tmp_path: Path, lens: tuple[str, tuple[float, ...]]
) -> None:
    rig = rig_with(lens)
    export_cameras(rig, tmp_path / "export")
    path = tmp_path / "export" / "camchain.yaml"
    chain = yaml.safe_load(path.read_text())
    T = se3.inverse(rig.T_rig_view(rig.view_names[0]))
    for index, name in enumerate(rig.view_names):
        entry = chain[f"cam{index}"]
        if index:
            T = np.array(entry["T_cn_cnm1"]) @ T
        fx, fy, cx, cy = entry["intrinsics"]
        K, D = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]]), np.array(entry["distortion_coeffs"])
        points, pixels = seen(rig, name)
        project = (
            cv2.fisheye.projectPoints if entry["distortion_model"] == "equidistant" else cv2.projectPoints
        )
        inside = se3.transform(T, points)  # Rodrigues' vectors lose digits near half a turn
        theirs = project(inside[:, None], np.zeros(3), np.zeros(3), K, D)[0].reshape(-1, 2)
        np.testing.assert_allclose(theirs, pixels, atol=0.1 if lens == BROWN else 1e-6)
    assert ("radtan fitted" in path.read_text()) is (lens == BROWN)
    if lens != BROWN:
        assert read_intrinsics(path) == rig.view_camera(rig.view_names[0])


def test_a_view_of_hardly_a_pixel_is_written_too(tmp_path: Path) -> None:
    rig = rig_with(BROWN)
    small = np.array([[400.2, 300.2], [401.8, 300.2], [400.2, 301.8]])
    tiny = replace(rig, views={**rig.views, "left": View(rig.views["left"].mirrors, small)})
    export_cameras(tiny, tmp_path / "export")
    assert read_intrinsics(tmp_path / "export" / "opencv" / "left.yaml") == rig.view_camera("left")


ROS = """\
image_width: 640
image_height: 480
camera_name: cam
camera_matrix: {rows: 3, cols: 3, data: [500.0, 0, 320.5, 0, 501.0, 240.5, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [-0.1, 0.02, 0.001, -0.002, 0.0]}
"""


def test_ros_cameras_are_read(tmp_path: Path) -> None:
    (tmp_path / "ros.yaml").write_text(ROS)
    camera = read_intrinsics(tmp_path / "ros.yaml")
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (500.0, 501.0, 320.5, 240.5)
    assert camera.distortion == (-0.1, 0.02, 0.001, -0.002, 0.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: 1", "neither an OpenCV camera"),
        ("- 1", "not a camera file"),
        ("a: [1\nb: 2", "not a usable YAML file (line 2, column 2: expected ',' or ']'"),
        (ROS.replace("plumb_bob", "division"), "use radtan or equidistant"),
        (ROS.replace("image_width: 640\n", ""), "no 'image_width'"),
        (ROS.replace("[500.0, 0,", "[500.0, 3,"), "skewed"),
        (ROS.replace("0.0]", "0.0, 0.1]").replace("cols: 5", "cols: 6"), "6 distortion numbers"),
        (ROS.replace("500.0", "-1"), "must be positive"),
    ],
)
def test_files_that_cannot_be(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "camera.yaml"
    path.write_text(text)
    with pytest.raises(SourceError) as caught:
        read_intrinsics(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert message in str(caught.value)


def test_colmap_pixels_are_half_a_pixel_on() -> None:
    model, params = colmap_camera(rig_with(PLAIN).camera)
    assert model == "FULL_OPENCV"
    assert params[2] == rig_with(PLAIN).camera.cx + 0.5
    assert json.dumps(params)
