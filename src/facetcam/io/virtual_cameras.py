"""The views of a rig as ordinary cameras, for Kalibr, OpenCV and COLMAP.

Every view is a proper camera: those behind an odd number of mirrors belong to the raw image flipped left to
right.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.optimize import least_squares

from facetcam.geometry import se3
from facetcam.io.outputs import atomic_write, writing
from facetcam.rig import Rig
from facetcam.rig.camera import KANNALA_BRANDT, Camera

Array = NDArray[np.float64]


def export_cameras(rig: Rig, folder: Path) -> None:
    """Write `camchain.yaml` (Kalibr), `opencv/VIEW.yaml` and `colmap/rig_config.json` into a new folder.

    Raises
    ------
    OutputError
        If a file cannot be written.
    """
    with writing(folder):
        for place in (folder, folder / "opencv", folder / "colmap"):
            place.mkdir(parents=True, exist_ok=True)
    atomic_write(folder / "camchain.yaml", kalibr_camchain(rig))
    atomic_write(folder / "colmap" / "rig_config.json", colmap_rig(rig))
    for name in rig.view_names:
        atomic_write(folder / "opencv" / f"{name}.yaml", opencv_camera(rig, name))


def kalibr_camchain(rig: Rig) -> str:
    """The rig as a Kalibr camchain; `T_cn_cnm1` maps coordinates of the camera before into this one's.

    Kalibr's radtan has no k3: where the lens has one, its four numbers are fitted to the lens over the view,
    and the largest difference stands in a comment.
    """
    chain: dict[str, Any] = {}
    comments = ["# Views of a mirror rig as proper cameras. Flip the raw image left to right for:"]
    flipped = [name for name in rig.view_names if rig.is_flipped(name)]
    comments.append(f"#   {', '.join(flipped) or 'none of them'}")
    before: Array | None = None
    for index, name in enumerate(rig.view_names):
        camera, T_rig_view = rig.view_camera(name), rig.T_rig_view(name)
        distortion, difference = _four_numbers(rig, name)
        if difference > 0.0:
            comments.append(f"# cam{index}: radtan fitted, off by {difference:.4f} px at most")
        fisheye = camera.model == KANNALA_BRANDT
        entry: dict[str, Any] = {
            "camera_model": "pinhole",
            "intrinsics": [float(n) for n in (camera.fx, camera.fy, camera.cx, camera.cy)],
            "distortion_model": "equidistant" if fisheye else "radtan",
            "distortion_coeffs": distortion,
            "resolution": [camera.width, camera.height],
            "rostopic": f"/{name}/image_raw",
            "cam_overlaps": [],
        }
        if before is not None:
            entry["T_cn_cnm1"] = (se3.inverse(T_rig_view) @ before).tolist()
        before = T_rig_view
        chain[f"cam{index}"] = entry
    return (
        "\n".join(comments)
        + "\n"
        + yaml.safe_dump(chain, sort_keys=False, default_flow_style=None, width=120)
    )


def _four_numbers(rig: Rig, view: str) -> tuple[list[float], float]:
    """Distortion as four numbers, and the largest difference in pixels over the view that this makes."""
    camera = rig.view_camera(view)
    numbers = [float(n) for n in camera.distortion]
    if camera.model == KANNALA_BRANDT or numbers[4] == 0.0:
        return numbers[:4], 0.0
    step = max(1, camera.width // 60)
    v, u = np.mgrid[0 : camera.height : step, 0 : camera.width : step].astype(np.float64)
    raw = np.stack([u.ravel(), v.ravel()], axis=1)
    seen = rig.sees(view, raw)
    own = raw[seen] if np.count_nonzero(seen) > 3 else raw
    if rig.is_flipped(view):
        own = np.stack([camera.width - 1 - own[:, 0], own[:, 1]], axis=1)
    rays = camera.ray(own)
    good = rays[:, 2] > 0
    rays, own = rays[good], own[good]

    def off(four: Array) -> Array:
        pixels, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), camera.K, four)
        return np.asarray(pixels[:, 0] - own, dtype=np.float64).ravel()

    found = np.asarray(least_squares(off, numbers[:4], method="lm").x, dtype=np.float64)
    return found.tolist(), float(np.linalg.norm(off(found).reshape(-1, 2), axis=1).max())


def opencv_camera(rig: Rig, view: str) -> str:
    """One view as OpenCV writes cameras, with its pose `T_rig_view` and whether it is flipped."""
    camera = rig.view_camera(view)
    file = cv2.FileStorage("camera.yaml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    file.write("image_width", camera.width)
    file.write("image_height", camera.height)
    file.write("camera_matrix", camera.K)
    file.write("distortion_coefficients", np.array(camera.distortion).reshape(-1, 1))
    file.write("fisheye_model", int(camera.model == KANNALA_BRANDT))
    file.write("T_rig_view", rig.T_rig_view(view))
    file.write("flipped", int(rig.is_flipped(view)))
    return str(file.releaseAndGetString())


def colmap_rig(rig: Rig) -> str:
    """A rig for COLMAP's `rig_configurator` (and `pycolmap.read_rig_config`).

    The first view is the reference. Half a pixel is added: COLMAP's (0, 0) is the corner of the first pixel.
    """
    first = rig.T_rig_view(rig.view_names[0])
    cameras = []
    for index, name in enumerate(rig.view_names):
        model, params = colmap_camera(rig.view_camera(name))
        entry: dict[str, Any] = {
            "image_prefix": f"{name}/",
            "camera_model_name": model,
            "camera_params": params,
        }
        if index == 0:
            entry["ref_sensor"] = True
        else:
            cam_from_ref = se3.inverse(rig.T_rig_view(name)) @ first
            x, y, z, w = se3.to_quaternion_xyzw(cam_from_ref).tolist()
            entry["cam_from_rig_rotation"] = [w, x, y, z]
            entry["cam_from_rig_translation"] = cam_from_ref[:3, 3].tolist()
        cameras.append(entry)
    return json.dumps([{"cameras": cameras}], indent=2) + "\n"


def colmap_camera(camera: Camera) -> tuple[str, list[float]]:
    """Model and parameters of a camera in COLMAP's order and pixels."""
    pinhole = [camera.fx, camera.fy, camera.cx + 0.5, camera.cy + 0.5]
    if camera.model == KANNALA_BRANDT:
        return "OPENCV_FISHEYE", [float(n) for n in (*pinhole, *camera.distortion)]
    k1, k2, p1, p2, k3 = camera.distortion
    return "FULL_OPENCV", [float(n) for n in (*pinhole, k1, k2, p1, p2, k3, 0.0, 0.0, 0.0)]
