"""Fixtures for all tests."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from command import Facetcam
from typer.testing import CliRunner

from facetcam.cli.app import app


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Films, rigs and photographs that are not part of the repository; tests without them are skipped."""
    beside = Path(__file__).parents[2] / "shared" / "data"
    folder = Path(os.environ.get("FACETCAM_DATA", beside))
    if not folder.is_dir():
        pytest.skip(f"no data in {folder}; set FACETCAM_DATA")
    return folder


@pytest.fixture
def facetcam() -> Facetcam:
    """Run `facetcam` with arguments."""
    return lambda *arguments: CliRunner().invoke(app, [str(argument) for argument in arguments])
