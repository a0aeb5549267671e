"""What a user of `pip install` gets: the wheel holds the native core, the templates and the type marker."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
def test_the_wheel_is_whole(tmp_path: Path) -> None:
    command = [
        sys.executable,
        "-m",
        "pip",
        "wheel",
        "--quiet",
        "--no-deps",
        "--wheel-dir",
        str(tmp_path),
        str(ROOT),
    ]
    subprocess.run(command, check=True, capture_output=True, text=True)
    (wheel,) = tmp_path.glob("facetcam-*.whl")
    held = set(zipfile.ZipFile(wheel).namelist())
    sources = [
        p for p in (ROOT / "src/facetcam").rglob("*") if p.suffix in (".py", ".html", ".css", ".typed")
    ]
    expected = {p.relative_to(ROOT / "src").as_posix() for p in sources}
    assert expected <= held
    assert any(name.startswith("facetcam/_core") for name in held)
