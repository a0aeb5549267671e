"""Scores as tables: text, CSV, JSON. A score that could not be measured is a dash, `nan` or null."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Sequence

import numpy as np

from facetcam.evaluation.detectors import Row

# What the first of the scores of each protocol say, and the others by their names.
MEANINGS = {
    "A": "share of points with one of the other image within 3 px (240x320, best 300)",
    "A px": "mean distance of those, px",
    "B": "share of points found again within 3 px, one to one",
    "B px": "mean distance of those, px",
    "points": "points of each image that took part",
    "C": "share of regions found again, overlap error under 0.4",
    **{f"D MMA@{t}": f"share of the matches within {t} px of the truth" for t in (1, 3, 5)},
    **{f"D H@{t}": f"share of pairs whose homography from RANSAC is within {t} px" for t in (1, 3, 5)},
}


def grid(rows: Sequence[Row], score: str) -> tuple[list[str], list[str], np.ndarray]:
    """Sequences, detectors, and the values of a score (sequences, detectors); NaN where none was measured."""
    detectors = list(dict.fromkeys(row.detector for row in rows))
    sequences = list(dict.fromkeys(row.sequence for row in rows))
    values = np.full((len(sequences), len(detectors)), np.nan)
    for row in rows:
        values[sequences.index(row.sequence), detectors.index(row.detector)] = row.scores[score]
    return sequences, detectors, values


def means(values: np.ndarray) -> np.ndarray:
    """Mean of each column over the rows that every column has; NaN where there are none."""
    complete = values[~np.isnan(values).any(axis=1)]
    return complete.mean(axis=0) if len(complete) else np.full(values.shape[1], np.nan)


def shown(score: str, value: float) -> str:
    """A score in figures."""
    return "-" if math.isnan(value) else f"{value:.0f}" if score == "points" else f"{value:.3f}"


def as_text(rows: Sequence[Row]) -> str:
    """One aligned table a score: sequences down, detectors across, their mean last."""
    lines = []
    for score in rows[0].scores if rows else ():
        sequences, detectors, values = grid(rows, score)
        first = 2 + max(map(len, [*sequences, score]))
        widths = [2 + max(len(name), 6) for name in detectors]
        lines.append(
            f"{score:{first}}" + "".join(f"{d:>{w}}" for d, w in zip(detectors, widths, strict=True))
        )
        for name, line in zip([*sequences, "mean"], [*values, means(values)], strict=True):
            cells = [f"{shown(score, value):>{w}}" for value, w in zip(line, widths, strict=True)]
            lines.append(f"{name:{first}}" + "".join(cells))
        lines.append("")
    return "\n".join(lines)


def as_csv(rows: Sequence[Row]) -> str:
    """Lines `sequence,detector,score,value`."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["sequence", "detector", "score", "value"])
    for row in rows:
        writer.writerows([row.sequence, row.detector, score, value] for score, value in row.scores.items())
    return text.getvalue()


def as_json(rows: Sequence[Row]) -> str:
    """A list of records; a score that is not finite becomes null."""
    records = [
        {
            "sequence": row.sequence,
            "detector": row.detector,
            "scores": {key: value if math.isfinite(value) else None for key, value in row.scores.items()},
        }
        for row in rows
    ]
    return json.dumps(records, indent=2, allow_nan=False) + "\n"
