"""Rigs found from sightings alone, against the rigs that made them."""

from __future__ import annotations

import numpy as np
import pytest

from facetcam.calibration.boards import Board, BoardSet
from facetcam.calibration.bootstrap import bootstrap
from facetcam.calibration.bootstrap_planes import Plane
from facetcam.calibration.bootstrap_reading import _cut
from facetcam.calibration.sightings import Sighting
from facetcam.errors import FacetcamError
from facetcam.geometry import se3
from facetcam.rig import Camera, Mirror, Rig, View

BOARDS = BoardSet((Board("plain", "chessboard", (8, 7), 0.03),))


def table(between_deg: float, seed: int) -> Rig:
    """A camera before two upright mirrors."""
    rng = np.random.default_rng(seed)
    camera = Camera("brown-conrady", 1600, 1200, 1300.0, 1300.0, 790.0, 610.0, (-0.08, 0.05, 0.0, 0.0, 0.0))
    half = np.radians(between_deg) / 2
    normals = {"left": (-np.cos(half), np.sin(half), 0.0), "right": (np.cos(half), np.sin(half), 0.0)}
    seam = np.array([0.02, 0.9, 0.0]) + rng.uniform(-0.02, 0.02, 3)
    mirrors = {n: Mirror.from_plane(n, v, float(np.array(v) @ seam)) for n, v in normals.items()}
    T = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
    tilt = se3.exp(np.r_[-0.5, 0.02, 0.03, 0.0, 0.0, 0.0])
    views = {"direct": View(()), "left": View(("left",)), "right": View(("right",)),
             "left-right": View(("left", "right"))}  # fmt: skip
    return Rig(camera, tilt @ T, mirrors, views)


def seen_by(rig: Rig, photos: int, seed: int, mirrored_known: bool) -> list[Sighting]:
    """What the camera sees of a board held before the mirrors; a plain one in the order of a direct look."""
    rng = np.random.default_rng(seed)
    board, out = BOARDS.boards[0], []
    for photo in range(photos):
        turn = se3.exp(np.r_[rng.uniform(-0.5, 0.5, 3), 0, 0, 0])[:3, :3]
        up = np.diag([1.0, -1.0, -1.0])  # lies on the table
        at = np.array([0.0, 0.62, -0.36]) + rng.uniform(-0.06, 0.06, 3)
        T = se3.from_rotation_translation(turn @ up, at - turn @ up @ board.points.mean(axis=0))
        for name in rig.views:
            image = se3.inverse(rig.T_rig_image(name)) @ T
            pixels, valid = rig.camera.project(se3.transform(image, board.points))
            if se3.inverse(image)[2, 3] >= 0 or not valid.all():
                continue
            corners = np.arange(42)
            if rig.is_flipped(name) and not mirrored_known:
                corners = corners.reshape(6, 7)[::-1].ravel()
            pixels = pixels + rng.normal(0, 0.15, pixels.shape)
            out.append(Sighting(photo, 0, corners, pixels, rig.is_flipped(name) if mirrored_known else None))
    return out


@pytest.mark.parametrize(("between_deg", "seed"), [(90.0, 0), (75.0, 1), (110.0, 2)])
def test_lens_mirrors_and_views_come_from_sightings_alone(between_deg: float, seed: int) -> None:
    true = table(between_deg, seed)
    sightings = seen_by(true, 7, seed, mirrored_known=False)
    rig, named = bootstrap(BOARDS, sightings, (1600, 1200))
    assert abs(rig.camera.fx / 1300.0 - 1) < 0.02
    assert len(named) >= 0.9 * len(sightings)
    normals = [rig.mirrors[n].normal for n in ("left", "right")]
    assert abs(180.0 - np.degrees(np.arccos(normals[0] @ normals[1])) - between_deg) < 1.0
    for name in ("left", "right"):
        turned = rig.mirrors[name].normal @ (rig.T_rig_cam[:3, :3] @ true.T_rig_cam[:3, :3].T
                                             @ true.mirrors[name].normal)  # fmt: skip
        assert turned > np.cos(np.radians(1.5))
    for s in named:
        assert s.mirrored == rig.is_flipped(s.view)


def test_sightings_keep_the_order_of_their_parity() -> None:
    """With the right chain and order every sighting of a photo tells the same place of the board."""
    true = table(90.0, 4)
    told, plain = (seen_by(true, 6, 4, known) for known in (True, False))
    _, named = bootstrap(BOARDS, plain, (1600, 1200))
    for s in named:
        same = [t for t in told if t.photo == s.photo]
        partner = min(same, key=lambda t: np.abs(t.pixels.mean(axis=0) - s.pixels.mean(axis=0)).max())
        order = np.argsort(s.corners)
        assert np.abs(s.pixels[order] - partner.pixels[s.corners[order]]).max() < 3


def test_without_mirrors_in_two_photos_nothing_is_made_up() -> None:
    rig = table(90.0, 3)
    direct = seen_by(Rig(rig.camera, rig.T_rig_cam, {}, {"direct": View(())}), 6, 3, False)
    with pytest.raises(FacetcamError, match="no plane mirror explains"):
        bootstrap(BOARDS, direct, (1600, 1200))
    with pytest.raises(FacetcamError, match="2 sightings"):
        bootstrap(BOARDS, direct[:2], (1600, 1200))


@pytest.mark.parametrize(("columns", "parts"), [(0, [7]), (1, [6]), (2, [5, 2]), (5, [2, 5])])
def test_a_row_of_corners_beyond_a_seam_makes_no_view(columns: int, parts: list[int]) -> None:
    """Of a board of 7 x 6 corners whose first `columns` lie beyond the seam of two mirrors."""
    camera = Camera("brown-conrady", 1600, 1200, 1300.0, 1300.0, 800.0, 600.0, (0.0,) * 5)
    normals = np.array([[-0.6, 0.0, 0.8], [0.6, 0.0, 0.8]])
    planes = [Plane(n, 1.0) for n in normals]  # their seam is upright in the middle of the frame
    x, y = np.meshgrid(np.arange(7.0), np.arange(6.0))
    pixels = np.column_stack([800.0 + 20.0 * (x.ravel() - columns + 0.5), 500.0 + 20.0 * y.ravel()])
    whole = Sighting(0, 0, np.arange(42), pixels, None)
    cut = _cut(BOARDS.boards[0], camera, planes, (1, 0), whole)
    assert [len(part.corners) for _, part in cut] == [6 * n for n in parts]
