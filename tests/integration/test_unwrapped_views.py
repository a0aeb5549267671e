"""Unwrapped views of the built-in room against pictures rendered without mirrors from the same places."""

from __future__ import annotations

from dataclasses import replace

import pytest

from facetcam.pipelines.demo_film import FPS, LENS, demo_rig
from facetcam.pipelines.demo_views import view_pairs
from facetcam.rig import Rig, presets
from facetcam.simulation.drive import round_the_table
from facetcam.simulation.film import Film, renderer_of
from facetcam.simulation.mesh_renderer import MeshRenderer
from facetcam.simulation.room import furnished_room

LEAST = 40.0  # decibels
PLACE = 50  # frame of the drive


@pytest.fixture(scope="module")
def room() -> MeshRenderer:
    return renderer_of(furnished_room())


@pytest.mark.parametrize(
    "rig", [presets.ryu(), presets.pyramid(5)], ids=["two mirrors a view", "one mirror a view"]
)
def test_unwrapped_views_agree_with_direct_ones(rig: Rig, room: MeshRenderer) -> None:
    through_a_lens = replace(rig, camera=replace(rig.camera, distortion=LENS))
    film = Film(through_a_lens, room, round_the_table(PLACE + 1, FPS))
    pairs = view_pairs(film, PLACE)
    assert {pair.name for pair in pairs} == set(rig.view_names)
    assert {pair.name: pair.psnr for pair in pairs if pair.psnr < LEAST} == {}
    assert all((pair.mask > 0).mean() > 0.2 for pair in pairs)


def test_a_shift_by_one_pixel_does_not_pass(room: MeshRenderer) -> None:
    film = Film(demo_rig(), room, round_the_table(PLACE + 1, FPS))
    for pair in view_pairs(film, PLACE):
        shifted = replace(pair, direct=pair.direct[:, [*range(1, pair.direct.shape[1]), 0]])
        assert shifted.psnr < LEAST - 3.0
