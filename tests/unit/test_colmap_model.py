"""COLMAP models of rigs, read back and projected by COLMAP."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from slam_worlds import fisheye, folded, look, pyramid, walls, winding_path

from facetcam.errors import OutputError
from facetcam.io.colmap_model import RigFrame, write_colmap_model
from facetcam.rig import Rig
from facetcam.slam.camera.optics import Optics

pycolmap = pytest.importorskip("pycolmap")


@pytest.mark.parametrize("rig", [folded(), pyramid(), fisheye()], ids=["folded", "pyramid", "fisheye"])
def test_colmap_projects_the_points_to_where_the_rig_saw_them(rig: Rig, tmp_path: Path) -> None:
    rng = np.random.default_rng(11)
    optics, points, poses = Optics(rig, 8.0), walls(rng, 400), winding_path(5)
    colour = rng.integers(0, 256, (len(points), 3), dtype=np.uint8)
    frames = []
    for k, T in enumerate(poses):
        sight = look(optics, T, points)
        frames.append(RigFrame(0.1 * k, T, sight.view, sight.point, sight.pixels))
    write_colmap_model(tmp_path / "colmap", rig, frames, points, colour)

    model = pycolmap.Reconstruction(str(tmp_path / "colmap"))
    assert model.num_rigs() == 1
    assert model.num_frames() == len(poses)
    assert model.num_images() == len(poses) * len(rig.views)
    assert model.compute_num_observations() == sum(len(f.point) for f in frames) > 100
    model.update_point_3d_errors()
    assert model.compute_mean_reprojection_error() < 1e-6
    first = model.find_image_with_name(f"{rig.view_names[-1]}/0.000000.png")
    assert np.allclose(first.projection_center(), (poses[0] @ rig.T_rig_view(rig.view_names[-1]))[:3, 3])


def test_a_run_without_keyframes_has_an_empty_model(tmp_path: Path) -> None:
    write_colmap_model(tmp_path / "colmap", folded(), [], np.zeros((0, 3)), np.zeros((0, 3), np.uint8))
    assert pycolmap.Reconstruction(str(tmp_path / "colmap")).num_images() == 0


def test_a_file_in_the_way_is_said(tmp_path: Path) -> None:
    (tmp_path / "colmap").write_text("")
    with pytest.raises(OutputError, match="colmap"):
        write_colmap_model(tmp_path / "colmap", folded(), [], np.zeros((0, 3)), np.zeros((0, 3), np.uint8))
