"""The native kernels of features and adjustment under AddressSanitizer and UndefinedBehaviorSanitizer."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[1] / "native" / "sanitize.sh"


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("c++") is None, reason="no C++ compiler")
def test_no_finding_on_random_sizes_strides_and_values(tmp_path: Path) -> None:
    run = subprocess.run(["sh", SCRIPT, tmp_path], capture_output=True, text=True, timeout=900)
    assert run.returncode == 0, run.stderr[-4000:]
    assert run.stdout.count("no finding") == 2
