"""Boards of a fixed set that moved, and photos of another camera: named as they were made."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest
from calibration_worlds import boards, disturbed, facing, nudge, walk
from numpy.typing import NDArray

from facetcam.calibration import Board, BoardSet
from facetcam.calibration.chessboards import placements
from facetcam.calibration.difference import projection_difference, room_points
from facetcam.calibration.evidence import worst_sighting
from facetcam.calibration.fit import Tolerance, looks_of
from facetcam.calibration.intruders import without_intruders
from facetcam.calibration.rereading import reread
from facetcam.calibration.result import Finding
from facetcam.calibration.sightings import Sighting
from facetcam.calibration.solve import solve, started
from facetcam.calibration.synthetic import projected_sightings
from facetcam.errors import FacetcamError
from facetcam.rig import presets

Array = NDArray[np.float64]
RIG, SET, NOISE = presets.pyramid(3), boards(4, True), 0.1


def seen(
    photos: int, moved: Mapping[int, Sequence[int]], zoomed: Sequence[int] = (), zoom: float = 1.06
) -> list[Sighting]:
    """Sightings of a walk; boards stand 20 mm and 2 degrees aside in some photos, some have another lens."""
    placed = [dict(p) for p in walk(RIG, SET, photos, 2)]
    for board, here in moved.items():
        for photo in here:
            placed[photo][board] = placed[photo][board] @ nudge(SET.boards[board], 0.02, 2.0, board)
    camera = replace(RIG.camera, fx=zoom * RIG.camera.fx, fy=zoom * RIG.camera.fy)
    other = replace(RIG, camera=camera)
    own = [s for s in projected_sightings(RIG, SET, placed, NOISE) if s.photo not in zoomed]
    return own + [s for s in projected_sightings(other, SET, placed, NOISE) if s.photo in zoomed]


def found(sightings: Sequence[Sighting]) -> tuple[list[Finding], float]:
    """Intruders, and how far the rig is off the truth, pixels; one sighting of few corners may be lost."""
    result = solve(RIG, SET, sightings)
    points = room_points(RIG, list(RIG.views), 200)
    lost = [f for f in result.findings if f.kind == "sighting rejected"]
    assert len(lost) <= 1
    intruders = [f for f in result.findings if f not in lost]
    return intruders, projection_difference(RIG, result.rig, points).rms


def test_names_the_board_that_moved() -> None:
    findings, off = found(seen(10, {2: (1, 4, 7)}))
    assert [(f.kind, f.photos) for f in findings] == [("moved board", (1, 7))]  # nothing is seen in photo 4
    assert "board 'board2' of" in findings[0].text
    away = re.search(r"([\d.]+) mm and ([\d.]+) degrees", findings[0].text)
    assert away is not None
    assert float(away[1]) == pytest.approx(20.0, abs=1.5)
    assert float(away[2]) == pytest.approx(2.0, abs=0.15)
    assert off < 1.0


@pytest.mark.slow
def test_says_when_either_of_two_boards_may_have_moved() -> None:
    pair = [s for s in seen(32, {1: range(16, 32)}) if s.board < 2]
    findings, _ = found(pair)
    assert [f.kind for f in findings] == ["moved board"]
    assert "'board0' or 'board1'" in findings[0].text or "'board1' or 'board0'" in findings[0].text
    assert "cannot tell" in findings[0].text


def test_names_the_photos_of_another_camera_though_they_are_a_quarter() -> None:
    findings, _ = found(seen(10, {}, (1, 4, 7)))
    assert [(f.kind, f.photos) for f in findings] == [("other camera", (1, 7))]
    named = re.findall(r"length of (\d+) px, the others (\d+) px", findings[0].text)[0]
    assert float(named[0]) / float(named[1]) == pytest.approx(1.06, abs=0.005)


@pytest.mark.slow
def test_names_both_when_a_board_moved_and_a_camera_was_changed() -> None:
    findings, off = found(seen(24, {3: range(12, 24)}, (3, 4, 10, 11, 17, 20), 1.05))
    kinds = {f.kind: f for f in findings}
    assert sorted(kinds) == ["moved board", "other camera"] and len(findings) == 2
    assert "board 'board3' of" in kinds["moved board"].text
    assert set(kinds["other camera"].photos) <= {3, 4, 10, 11, 17, 20}
    assert off < 0.5


def test_nothing_is_found_where_nothing_is_wrong() -> None:
    findings, off = found(seen(10, {}))
    assert not findings and off < 1.0


def test_a_finding_names_the_photos() -> None:
    finding = Finding("other camera", "photos {photos} differ", tuple(range(14)))
    assert finding.told(["a.jpg", "b.jpg"]).startswith("photos a.jpg, b.jpg, 2, ")
    assert finding.text.endswith("11 and 2 more differ")


def test_a_part_of_a_chessboard_read_squares_astray_is_read_anew() -> None:
    rig, board = presets.table(), Board("plain", "chessboard", (10, 7), 0.016)
    random, eye, set = np.random.default_rng(1), rig.T_rig_cam[:3, 3], BoardSet((board,), False)
    ways = [np.array([0.0, -0.26, 0.14]) + random.uniform(-0.06, 0.06, 3) - eye for _ in range(8)]
    placed = [{0: facing(board, eye, way, float(np.linalg.norm(way)), random)} for way in ways]
    true = projected_sightings(rig, set, placed, 0.05)
    at = next(i for i, s in enumerate(true) if s.photo == 2 and s.mirrored and len(s) == 54)
    part = true[at].corners % 9 < 7
    true[at] = replace(true[at], corners=true[at].corners[part], pixels=true[at].pixels[part])
    # A photo tells neither handedness nor which part it is.
    found = [replace(placements(s, board, False)[0], mirrored=None) for s in true]
    fit = started(disturbed(rig, 1.0, 0.002, 0.03, 1), set, found, Tolerance()).solved(10.0)
    row = next(i for i, s in enumerate(fit.sightings) if len(s) == len(true[at]) and s.photo == 2)
    named = list(fit.sightings)
    others = [w for w in placements(found[at], board, True) if np.any(w.corners != true[at].corners)]
    named[row] = replace(named[row], corners=others[0].corners)
    looks = looks_of(named, set, fit.views, fit.looks.board, fit.looks.station)
    astray = replace(fit, sightings=tuple(named), looks=looks).solved(10.0)
    assert worst_sighting(astray.solved(1.0)) > 5.0
    mended = reread(astray, set, found)
    np.testing.assert_array_equal(mended.sightings[row].corners, true[at].corners)
    assert worst_sighting(mended.solved(1.0)) < 0.2
    assert without_intruders(mended, set)[1] == ()


def test_a_set_called_fixed_that_never_was_is_refused() -> None:
    placed = [
        {b: T @ nudge(SET.boards[b], 0.05, 10.0, 10 * photo + b) for b, T in stand.items()}
        for photo, stand in enumerate(walk(RIG, SET, 10, 2))
    ]
    sightings = projected_sightings(RIG, SET, placed, NOISE)
    with pytest.raises(FacetcamError, match=r"\d of \d photos the boards .* 'fixed: false' in boards.yaml"):
        solve(RIG, SET, sightings)
    loose = solve(RIG, replace(SET, fixed=False), sightings)
    assert loose.rms() < 2 * NOISE
