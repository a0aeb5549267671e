"""Boards of a fixed set that moved by little are named; faults of other kinds are not taken for it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from calibration_worlds import boards, disturbed, nudge, walk
from numpy.typing import NDArray

from facetcam.calibration.difference import projection_difference, room_points
from facetcam.calibration.moved_boards import _placed_anew
from facetcam.calibration.result import Finding
from facetcam.calibration.sightings import Sighting
from facetcam.calibration.small_moves import put_back
from facetcam.calibration.solve import solve
from facetcam.calibration.synthetic import projected_sightings
from facetcam.rig import Rig, presets

Array = NDArray[np.float64]
NOISE, PHOTOS, LATER = 0.01, 18, range(9, 14)
WORLDS = {"pyramid": (presets.pyramid(3), boards(4, True)), "ryu": (presets.ryu(), boards(6, True))}


def seen(world: str, seed: int, shift: float = 0.0, degrees: float = 0.0) -> list[Sighting]:
    """Sightings of a walk; `board1` stands aside in five photos."""
    rig, set = WORLDS[world]
    placed = [dict(p) for p in walk(rig, set, PHOTOS, seed)]
    for photo in LATER if shift else ():
        placed[photo][1] = placed[photo][1] @ nudge(set.boards[1], shift, degrees, 1)
    return projected_sightings(rig, set, placed, NOISE, seed)


def moved(world: str, sightings: Sequence[Sighting], seed: int) -> tuple[list[Finding], float]:
    """Boards said to have moved, and how far the rig is off the truth, pixels."""
    rig, set = WORLDS[world]
    result = solve(disturbed(rig, 1.0, 0.002, 0.03, seed), set, sightings)
    off = projection_difference(rig, result.rig, room_points(rig, list(rig.views), 200)).rms
    return [f for f in result.findings if f.kind == "moved board"], off


@pytest.mark.parametrize(
    ("world", "seed", "shift", "degrees"),
    [("pyramid", 2, 0.008, 1.5), ("pyramid", 2, 0.003, 0.5), ("ryu", 3, 0.001, 0.2), ("ryu", 6, 0.003, 0.5)],
)
def test_names_a_board_that_moved_a_little(world: str, seed: int, shift: float, degrees: float) -> None:
    still = moved(world, seen(world, seed), seed)[1]
    findings, off = moved(world, seen(world, seed, shift, degrees), seed)
    assert len(findings) == 1 and set(findings[0].photos) <= set(LATER)
    assert "board 'board1' of" in findings[0].text
    told = re.search(r"([\d.]+) mm and ([\d.]+) degrees", findings[0].text)
    assert told is not None
    assert float(told[1]) == pytest.approx(1e3 * shift, abs=0.35)
    assert float(told[2]) == pytest.approx(degrees, abs=0.05)
    assert off < 2.0 * still


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize("seed", [2, 3])
def test_nothing_moved_where_sightings_are_off_by_chance(world: str, seed: int) -> None:
    random = np.random.default_rng(seed)
    whole = [replace(s, pixels=s.pixels + random.normal(0, 0.03, 2)) for s in seen(world, seed)]
    assert moved(world, whole, seed)[0] == []


@pytest.mark.parametrize("world", WORLDS)
def test_another_focus_in_some_photos_is_no_moved_board(world: str) -> None:
    rig, set = WORLDS[world]
    camera = replace(rig.camera, fx=1.0005 * rig.camera.fx, fy=1.0005 * rig.camera.fy)
    other = Rig(camera, rig.T_rig_cam, rig.mirrors, rig.views)
    later = projected_sightings(other, set, walk(rig, set, PHOTOS, 2), NOISE, 2)
    both = [s for s in seen(world, 2) if s.photo < 12] + [s for s in later if s.photo >= 12]
    assert moved(world, both, 2)[0] == []


@pytest.mark.parametrize("world", WORLDS)
def test_a_lens_that_is_not_quite_its_model_moves_no_board(world: str) -> None:
    size = np.array([WORLDS[world][0].camera.width, WORLDS[world][0].camera.height])

    def waves(pixels: Array) -> Array:
        u, v = (np.pi * pixels / size).T
        return 0.1 * np.column_stack([np.cos(2 * u) * np.cos(3 * v), np.cos(3 * u) * np.cos(v)])

    bent = [replace(s, pixels=s.pixels + waves(s.pixels)) for s in seen(world, 2)]
    assert moved(world, bent, 2)[0] == []


def test_a_move_that_explains_nothing_is_put_back() -> None:
    world, seed = "ryu", 3
    rig, set = WORLDS[world]
    drawing = disturbed(rig, 1.0, 0.002, 0.03, seed)
    said = Finding("moved board", "board 'board1' of the fixed set moved", tuple(LATER))
    still = solve(drawing, set, seen(world, seed)).fit
    astray = still.state.T_station_board[1] @ nudge(set.boards[1], 2e-5, 0.002, 1)
    moved = _placed_anew(still, 1, list(LATER), astray).solved(None)
    back, told = put_back(moved, set, (said,))
    assert told == () and not back.moved
    true = solve(drawing, set, seen(world, seed, 0.001, 0.2))
    moves = tuple(f for f in true.findings if f.kind == "moved board")
    assert len(moves) == 1 and put_back(true.fit, set, moves)[1] == moves
