"""`kill -9` while a map is written: the last whole map and the trajectory so far stay readable."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from films import write_film
from slam_worlds import folded

from facetcam.io.trajectories import read_tum
from facetcam.pipelines.slam_maps import FILE
from facetcam.simulation.drive import round_the_table
from facetcam.simulation.film import Film, renderer_of
from facetcam.simulation.room import furnished_room
from facetcam.slam.map.file import read_map

pytestmark = pytest.mark.slow

FRAMES = 40
KILLS = 8
LONGEST = 1.5  # seconds from the first map to the kill
ALWAYS_SAVING = """\
import facetcam.pipelines.slam_maps as maps
maps._EVERY, maps._SHARE = 0.0, 1.0
from facetcam.cli import main
main()
"""


@pytest.fixture(scope="module")
def command(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """`facetcam slam` on a film of a room, with a map written after nearly every frame."""
    folder, rig = tmp_path_factory.mktemp("film"), folded()
    images = list(Film(rig, renderer_of(furnished_room()), round_the_table(FRAMES)))
    film = write_film(folder / "film.mp4", images, source="bgr24" if images[0].ndim == 3 else "gray")
    rig.save(folder / "rig.yaml")
    words = [sys.executable, "-c", ALWAYS_SAVING, "slam", film, "--rig", folder / "rig.yaml"]
    return [str(word) for word in words]


def kill(command: list[str], out: Path, seconds: float) -> None:
    """Run until a map is there and some time longer, then kill it as nothing can be cleaned up after."""
    with subprocess.Popen([*command, "--out", str(out)], stderr=subprocess.DEVNULL) as process:
        while not (out / FILE).exists():
            assert process.poll() is None, "it ended before a map was written"
            time.sleep(0.01)
        time.sleep(seconds)
        process.kill()


def test_a_killed_run_leaves_a_whole_map(command: list[str], tmp_path: Path) -> None:
    sizes = set()
    for k, seconds in enumerate(np.random.default_rng(0).uniform(0.0, LONGEST, KILLS)):
        out = tmp_path / str(k)
        kill(command, out, float(seconds))
        header, _ = read_map(out / FILE)
        assert header.keyframes >= 2
        assert len(read_tum(out / "trajectory.tum")[0]) >= 1
        sizes.add((header.keyframes, header.points))
    assert len(sizes) > 1  # the kills fell on different maps
