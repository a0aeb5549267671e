"""Photos of another focal length are left out, a lens that breathes is told, other faults are not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from calibration_worlds import boards, disturbed, nudge, walk
from numpy.typing import NDArray

from facetcam.calibration.difference import projection_difference, room_points
from facetcam.calibration.result import Finding
from facetcam.calibration.sightings import Sighting
from facetcam.calibration.solve import solve
from facetcam.calibration.synthetic import projected_sightings
from facetcam.rig import presets

Array = NDArray[np.float64]
NOISE, PHOTOS = 0.01, 18
WORLDS = {"pyramid": (presets.pyramid(3), boards(4, True)), "ryu": (presets.ryu(), boards(6, True))}


def placed(world: str, seed: int) -> list[dict[int, Array]]:
    """Where the boards stand in each photo."""
    return [dict(p) for p in walk(*WORLDS[world], PHOTOS, seed)]


def seen(
    world: str, poses: list[dict[int, Array]], seed: int, focal: Mapping[int, float] = {}
) -> list[Sighting]:
    """Sightings of a walk, some photos with a focal length that is larger by a share."""
    rig, set = WORLDS[world]
    out = []
    for share in {0.0, *focal.values()}:
        camera = replace(rig.camera, fx=(1 + share) * rig.camera.fx, fy=(1 + share) * rig.camera.fy)
        whole = projected_sightings(replace(rig, camera=camera), set, poses, NOISE, seed)
        out += [s for s in whole if focal.get(s.photo, 0.0) == share]
    return out


def found(world: str, sightings: list[Sighting], seed: int) -> tuple[list[Finding], float]:
    """Faults of photos, and how far the rig is off the truth, pixels."""
    rig, set = WORLDS[world]
    result = solve(disturbed(rig, 1.0, 0.002, 0.03, seed), set, sightings)
    off = projection_difference(rig, result.rig, room_points(rig, list(rig.views), 200)).rms
    return [f for f in result.findings if f.kind != "sighting rejected"], off


@pytest.mark.parametrize(
    ("world", "seed", "share"),
    [("pyramid", 5, 0.0035), ("pyramid", 6, 0.0005), ("ryu", 4, 0.0035), ("ryu", 6, 0.0015)],
)
def test_photos_of_another_focus_are_left_out(world: str, seed: int, share: float) -> None:
    later, poses = range(12, PHOTOS), placed(world, seed)
    findings, off = found(world, seen(world, poses, seed, dict.fromkeys(later, share)), seed)
    assert [f.kind for f in findings] == ["other focus"]
    assert len(findings[0].photos) >= 3 and set(findings[0].photos) <= set(later)
    assert float(findings[0].text.split("up to ")[1].split(" %")[0]) == pytest.approx(100 * share, abs=0.03)
    still = found(world, [s for s in seen(world, poses, seed) if s.photo not in later], seed)
    assert off < 1.5 * still[1] + 0.01


@pytest.mark.parametrize(
    ("world", "seed", "shift"), [("pyramid", 3, 12.0), ("pyramid", 1, 4.0), ("ryu", 2, 12.0)]
)
def test_photos_of_a_camera_of_the_same_make_are_left_out(world: str, seed: int, shift: float) -> None:
    """The same focal length, another principal point: every photo of it is shifted as a whole."""
    others, poses = {2, 7, 11, 13, 15}, placed(world, seed)
    whole = [
        replace(s, pixels=s.pixels + np.array([shift, -0.7 * shift])) if s.photo in others else s
        for s in seen(world, poses, seed)
    ]
    findings, off = found(world, whole, seed)
    assert [f.kind for f in findings] == ["other focus"]
    assert len(findings[0].photos) >= 3 and set(findings[0].photos) <= others
    told = float(findings[0].text.split("up to ")[1].split(" px")[0])
    assert told == pytest.approx(float(np.hypot(shift, 0.7 * shift)), rel=0.15)
    assert off < 0.1
    names = [f"p{k}.jpg" for k in range(PHOTOS)]
    assert f"in {', '.join(names[p] for p in findings[0].photos)} by" in findings[0].told(names)


@pytest.mark.parametrize("world", WORLDS)
def test_a_lens_that_breathes_is_told_and_blamed_on_no_board(world: str) -> None:
    random = np.random.default_rng(8)
    focal = {photo: float(0.002 * random.standard_normal()) for photo in range(PHOTOS)}
    findings, _ = found(world, seen(world, placed(world, 1), 1, focal), 1)
    assert {"focus"} <= {f.kind for f in findings} <= {"focus", "other camera"}  # by 0.4 % it counts as that
    assert "take all anew with one lens held still" in findings[-1].text


@pytest.mark.parametrize(("world", "seed"), [("pyramid", 2), ("ryu", 6)])
def test_a_board_that_moved_is_no_other_focus(world: str, seed: int) -> None:
    poses = placed(world, seed)
    for photo in range(9, 14):
        poses[photo][1] = poses[photo][1] @ nudge(WORLDS[world][1].boards[1], 0.003, 0.5, 1)
    findings, _ = found(world, seen(world, poses, seed), seed)
    assert {f.kind for f in findings} == {"moved board"}


@pytest.mark.parametrize("fault", ["nothing", "sightings astray", "wrong corners"])
@pytest.mark.parametrize("world", WORLDS)
def test_other_faults_are_no_other_focus(world: str, fault: str) -> None:
    random = np.random.default_rng(5)

    def spoiled(pixels: Array) -> Array:
        if fault == "sightings astray":
            return pixels + 0.05 * random.standard_normal(2)
        wrong = (random.random((len(pixels), 1)) < 0.15) & (fault == "wrong corners")
        return pixels + 2.0 * wrong * random.standard_normal(pixels.shape)

    whole = [replace(s, pixels=spoiled(s.pixels)) for s in seen(world, placed(world, 5), 5)]
    assert not [f for f in found(world, whole, 5)[0] if "focus" in f.kind]


@pytest.mark.parametrize("seed", [2, 4, 5])
def test_few_photos_with_wrong_sightings_are_of_one_focus(seed: int) -> None:
    """Three boards, most photos show two of them; a scale of each photo would take up what is wrong there."""
    rig, set = presets.ryu(), boards(3, True, squares=(8, 4))
    random = np.random.default_rng(seed)
    sightings = []
    for s in projected_sightings(rig, set, walk(rig, set, 20, seed), 0.0, seed):
        pixels, noise = s.pixels, 0.004 * np.exp(random.normal()) * (6 if s.board == 1 else 1)
        if random.random() < 0.12:
            pixels = pixels + random.normal(0, 0.4, 2)
            pixels = pixels + (pixels - pixels.mean(axis=0)) * random.normal(0, 0.004)
        pixels = pixels + 0.5 * noise * random.normal(size=2) + noise * random.normal(size=pixels.shape)
        sightings.append(replace(s, pixels=pixels))
    result = solve(disturbed(rig, 3.0, 0.005, 0.1, seed), set, sightings)
    assert not [f for f in result.findings if "focus" in f.kind]
