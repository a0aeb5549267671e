"""A new user's way, by the command line alone: drawing, photos and film in the computer, calibration, map."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from command import Facetcam

from facetcam.io.trajectories import read_tum
from facetcam.rig import Rig
from facetcam.simulation.meshes import Material, quad
from facetcam.simulation.room import furnished_room

pytestmark = pytest.mark.slow

# The paper's rig with half the pixels a side.
DRAWING = """
family: {radius: 0.0675, tilt_degrees: 37, height: 0.125, depth: 0.06, aspect: 1.3333, camera_height: 0.055}
camera: {width: 800, height: 600, focal: 625}
"""
SETTINGS = """
camera: {exposure_time: 0.004}
light: {lamps: [{position: [-1.5, 0.2, 2.3]}, {position: [1.5, -0.2, 2.3]}]}
build: {tilt_degrees: 0.3, shift_mm: 0.2, camera_degrees: 0.2, camera_mm: 0.2, focal_percent: 0.5}
"""
ROUND = "x,y\n-0.4,-1.0\n0.8,-0.9\n1.4,0\n0.8,0.9\n-0.4,1.0\n-1.2,0\n-0.4,-1.0\n"
LONGEST = 0.03  # metres, of the films with odometry


def room_without_table(path: Path) -> Path:
    """The built-in room as a file; what stands in its middle would hide the boards."""
    import trimesh
    from PIL import Image

    scene = trimesh.Scene()
    for surface in furnished_room().surfaces:
        middle = surface.corner + surface.right / 2 + surface.down / 2
        if np.abs(middle[:2]).max() < 1.0 and 0.02 < middle[2] < 1.0:
            continue
        small = cv2.resize(surface.picture, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        picture = surface.picture if min(surface.picture.shape[:2]) < 64 else small
        q = quad(surface.corner, surface.right, surface.down, Material(picture))
        material = trimesh.visual.material.PBRMaterial(
            baseColorTexture=Image.fromarray(picture), metallicFactor=0.0
        )
        visual = trimesh.visual.TextureVisuals(uv=q.uv * (1, -1) + (0, 1), material=material)
        scene.add_geometry(trimesh.Trimesh(q.vertices, q.faces, visual=visual, process=False))
    scene.export(path)
    return path


def test_a_rig_from_a_drawing_is_filmed_calibrated_unwrapped_and_mapped(
    tmp_path: Path, facetcam: Facetcam
) -> None:
    pytest.importorskip("trimesh", reason="pip install facetcam[sim]")
    scene = room_without_table(tmp_path / "room.glb")
    for name, text in (("drawing.yaml", DRAWING), ("settings.yaml", SETTINGS), ("round.csv", ROUND)):
        (tmp_path / name).write_text(text)

    def run(command: str, *arguments: object) -> Path:
        out = tmp_path / f"{command}-{len(list(tmp_path.glob(command + '-*')))}"
        result = facetcam(command, *arguments, "--out", out)
        assert result.exit_code == 0, result.output
        return out

    drawn = run("design", tmp_path / "drawing.yaml", "--no-tolerance") / "rig.yaml"
    of_scene = ("--rig", drawn, "--settings", tmp_path / "settings.yaml", "--drive", tmp_path / "round.csv")
    photos = run("simulate", scene, *of_scene, "--boards", 16)
    film = run("simulate", scene, *of_scene)
    nominal, boards = photos / "rig_nominal.yaml", photos / "boards.yaml"
    rig = run("calibrate", photos / "frames", "--rig", nominal, "--boards", boards) / "rig.yaml"

    views = run("unwrap", film / "film.mp4", "--rig", rig, "--max-frames", 1)
    for name in Rig.load(drawn).view_names:
        assert cv2.imread(str(views / name / "000000.png")).std() > 10

    truth = film / "truth.tum"
    mapped = run(
        "slam", film / "film.mp4", "--rig", rig, "--odometry", film / "odometry.csv", "--truth", truth
    )
    summary = json.loads((mapped / "summary.json").read_text())
    _, poses = read_tum(truth)
    length = float(np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1).sum())
    assert summary["tracked"] == summary["frames"] == len(poses)
    assert summary["errors"]["ate_scaled"]["rmse"] < 0.005 * length
    assert summary["errors"]["ate"]["rmse"] < LONGEST
