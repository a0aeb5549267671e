"""The same film gives the same path and map, to the byte, whatever the number of threads."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

LIMITS = ("OPENCV_FOR_THREADS_NUM", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")
WRITTEN = ("trajectory.tum", "map.ply", "states.csv")


def run(source: Path, rig: Path, out: Path, threads: int) -> dict[str, bytes]:
    """Results of `facetcam slam` in a process whose libraries may use so many threads."""
    facetcam = Path(sys.executable).with_name("facetcam")
    words = [facetcam, "slam", source, "--rig", rig, "--max-frames", "150", "--out", out]
    environment = os.environ | dict.fromkeys(LIMITS, str(threads))
    subprocess.run([str(word) for word in words], check=True, capture_output=True, env=environment)
    return {name: (out / name).read_bytes() for name in WRITTEN}


@pytest.mark.parametrize(
    ("source", "rig"),
    [("house/loop.mp4", "house/rig_true.yaml"), ("kitchen", "kitchen/rig.yaml")],
    ids=["loop", "kitchen"],
)
def test_runs_are_alike_to_the_byte(shared_data: Path, tmp_path: Path, source: str, rig: str) -> None:
    first = run(shared_data / source, shared_data / rig, tmp_path / "first", 1)
    assert len(first["trajectory.tum"].splitlines()) > 100
    for threads in (1, 2, 4):
        assert run(shared_data / source, shared_data / rig, tmp_path / str(threads), threads) == first
