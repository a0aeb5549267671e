"""`facetcam demo`: its table and exit code; the run itself is tested in tests/integration."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import Any

import pytest
from command import Facetcam, only_line

from facetcam.pipelines import demo as pipeline
from facetcam.viz.report import Check

GOOD, BAD = Check("path error", "0.01 m", "≤ 0.02 m", True), Check("scale", "3 %", "≤ 1 %", False)


def stand_in(monkeypatch: pytest.MonkeyPatch, *checks: Check) -> dict[str, Any]:
    """Replace the run by one that finds these checks; returns what it was asked for."""
    asked: dict[str, Any] = {}

    def run_demo(out: Path, **options: Any) -> pipeline.Demo:
        asked.update(options, out=out)
        with options["stage"]("filming") as progress:
            progress(1, 2)
        return pipeline.Demo(checks, out / "report.html")

    monkeypatch.setattr(pipeline, "run_demo", run_demo)
    return asked


def test_a_good_run_prints_its_table_and_the_report(
    facetcam: Facetcam, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    asked = stand_in(monkeypatch, GOOD)
    result = facetcam("demo", "--quick", "--out", tmp_path / "run")
    assert result.exit_code == 0, result.output
    assert asked["quick"] is True
    assert "path error" in result.stdout
    assert "report.html" in result.stdout


def test_a_quantity_out_of_bounds_fails_and_says_so(
    facetcam: Facetcam, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    asked = stand_in(monkeypatch, GOOD, BAD)
    result = facetcam("demo", "--out", tmp_path / "run")
    assert asked["quick"] is False
    assert "1 of 2 quantities" in only_line(result)
    assert "missed" in result.stdout


def test_a_folder_that_exists_is_refused(facetcam: Facetcam, tmp_path: Path) -> None:
    assert "exists already" in only_line(facetcam("demo", "--out", tmp_path))


def test_ctrl_c_strikes_amid_a_frame(
    facetcam: Facetcam, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    calls = []

    def struck(*given: object) -> float:
        calls.append(given)
        signal.raise_signal(signal.SIGINT)
        return 1.0

    monkeypatch.setattr("facetcam.simulation.sensor.AutoExposure.follow", struck)
    result = facetcam("demo", "--quick", "--out", tmp_path / "run")
    assert result.exit_code == 130, result.output
    assert len(calls) == 1
    assert result.stderr.startswith("facetcam: stopped")
