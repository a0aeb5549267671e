"""A new user's way with the files that the page shows: drawing, photos and film, calibration, map."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from command import Facetcam

from facetcam.io.trajectories import read_tum
from facetcam.rig import Rig

pytestmark = pytest.mark.slow

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "drawing-to-map.md"
ROOM = Path(__file__).parents[2] / "examples" / "07_a_room_to_film.py"
LONGEST = 0.03  # metres, of the films with odometry


def shown(title: str) -> str:
    """The file of that name as the page shows it."""
    return PAGE.read_text().split(f'title="{title}"\n')[1].split("```")[0]


def test_a_rig_from_a_drawing_is_filmed_calibrated_unwrapped_and_mapped(
    tmp_path: Path, facetcam: Facetcam
) -> None:
    pytest.importorskip("trimesh", reason="pip install facetcam[sim]")
    subprocess.run([sys.executable, ROOM], cwd=tmp_path, check=True)
    scene = tmp_path / "room.glb"
    for name in ("drawing.yaml", "settings.yaml", "round.csv"):
        (tmp_path / name).write_text(shown(name))

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
