"""The page that compares detectors: their means, every table with its best marked, corners under change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from facetcam.evaluation.detectors import Row
from facetcam.evaluation.tables import MEANINGS, grid, means, shown
from facetcam.viz import figures
from facetcam.viz.pages import embedded, write_page
from facetcam.viz.report import Picture

_HEADLINES = ("A", "B", "C", "D MMA@3")  # the scores that are drawn
_SMALLER_IS_BETTER = (" px",)


@dataclass(frozen=True, slots=True)
class DetectorsReport:
    """What the page shows; `changed` are the corners of one detector, `compared` those of each."""

    title: str
    rows: Sequence[Row]
    changed: Sequence[Picture]
    compared: Sequence[Picture]
    interrupted: str = ""


def write_detectors_report(report: DetectorsReport, path: Path) -> None:
    """Write the page; raises `OutputError` when it cannot be written."""
    scores = list(report.rows[0].scores) if report.rows else []
    drawn = [score for score in _HEADLINES if score in scores]
    context = {
        "title": report.title,
        "interrupted": report.interrupted,
        "verdict": [_verdict(report.rows, score) for score in drawn],
        "figures": [_bars(report.rows, score) for score in drawn],
        "tables": [_table(report.rows, score) | {"open": score in (*drawn, "points")} for score in scores],
        "changed": [embedded(picture) for picture in report.changed],
        "compared": [embedded(picture) for picture in report.compared],
    }
    write_page("detectors.html", path, context)


def _verdict(rows: Sequence[Row], score: str) -> dict[str, str]:
    """Who is best on average by a score."""
    _, detectors, values = grid(rows, score)
    average = means(values)
    if np.isnan(average).all():
        return {"score": score, "best": "-", "value": "-", "meaning": MEANINGS[score]}
    best = int(np.nanargmax(average))
    return {
        "score": score,
        "best": detectors[best],
        "value": shown(score, average[best]),
        "meaning": MEANINGS[score],
    }


def _bars(rows: Sequence[Row], score: str) -> dict[str, Any]:
    _, detectors, values = grid(rows, score)
    average = dict(zip(detectors, means(values).tolist(), strict=True))
    known = {name: value for name, value in average.items() if not np.isnan(value)}
    ordered = dict(sorted(known.items(), key=lambda item: -item[1]))
    return {"score": score, "svg": Markup(figures.scores_figure(ordered, f"mean {score}")) if ordered else ""}


def _table(rows: Sequence[Row], score: str) -> dict[str, Any]:
    """The lines of a table, the mean last."""
    sequences, detectors, values = grid(rows, score)
    lines = [
        {"name": name, "cells": _cells(score, line)}
        for name, line in zip([*sequences, "mean"], [*values, means(values)], strict=True)
    ]
    return {"score": score, "meaning": MEANINGS[score], "detectors": detectors, "lines": lines}


def _cells(score: str, line: np.ndarray) -> list[dict[str, Any]]:
    """Figures of a line, how strongly to tint them (percent), and whether each is the best."""
    share = score != "points" and not score.endswith(_SMALLER_IS_BETTER)
    ranked = -line if score.endswith(_SMALLER_IS_BETTER) else line
    best = np.nan if score == "points" or np.isnan(line).all() else np.nanmax(ranked)
    return [
        {
            "text": shown(score, value),
            "strength": round(45 * value) if share and not np.isnan(value) else 0,
            "best": rank == best and len(line) > 1,
        }
        for value, rank in zip(line.tolist(), ranked.tolist(), strict=True)
    ]
