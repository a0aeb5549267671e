"""Fixtures for all tests."""

from __future__ import annotations

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Films, rigs and photographs that are not part of the repository; tests without them are skipped."""
    beside = Path(__file__).parents[2] / "shared" / "data"
    folder = Path(os.environ.get("FACETCAM_DATA", beside))
    if not folder.is_dir():
        pytest.skip(f"no data in {folder}; set FACETCAM_DATA")
    return folder
