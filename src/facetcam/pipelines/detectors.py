"""From folders of images to tables, plots and pictures that compare detectors."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from facetcam.evaluation.datasets import find_sequences
from facetcam.evaluation.detectors import Row, evaluate_change, evaluate_sequence
from facetcam.evaluation.peers import Peer, peers
from facetcam.evaluation.synthetic import changes
from facetcam.features.images import Image
from facetcam.io.outputs import atomic_write, fresh_folder, require_absent
from facetcam.pipelines.progress import Progress, silent
from facetcam.viz import figures

_SHEET = ("scale 0.7", "rotation 30", "affine")  # beside the original, as in Fig. 12 of the paper
_SHEET_POINTS = 300


def run_detectors(
    datasets: Sequence[Path | str],
    out: Path | str | None = None,
    *,
    names: Sequence[str] | None = None,
    protocols: str = "BD",
    top: int = 1000,
    synthetic: bool = False,
    progress: Progress = silent,
) -> dict[str, str]:
    """Compare detectors on image sequences.

    Parameters
    ----------
    datasets : paths
        Folders of images in the Oxford or HPatches layout, or of one view under changing light; or folders of
        such folders.
    out : path, optional
        Folder to make for `scores.txt`, `scores.csv`, `scores.json`, `scores.svg` and `corners.png`.
    names : sequence of str, optional
        Detectors, all by default.
    protocols : str
        Letters of A, B, C and D.
    top : int
        Points that take part.
    synthetic : bool
        Also change the first image of every sequence in known ways.

    Returns
    -------
    The tables by format: text, csv, json.

    Raises
    ------
    FacetcamError
        An unreadable folder, an unknown detector or protocol, or an output folder that exists.
    """
    if out is not None:
        require_absent(out)
    compared = peers(list(names) if names else None)
    sequences = [sequence for folder in datasets for sequence in find_sequences(Path(folder))]
    firsts = [sequence.images()[0] for sequence in sequences]
    applied = changes() if synthetic else {}
    total = len(compared) * (len(sequences) + len(applied))
    rows: list[Row] = []
    for detector, peer in compared.items():
        for sequence in sequences:
            rows.append(evaluate_sequence(sequence, detector, peer, protocols, top))
            progress(len(rows), total)
        for name, change in applied.items():
            rows.append(evaluate_change(firsts, name, change, detector, peer, protocols, top))
            progress(len(rows), total)
    tables = {"text": as_text(rows), "csv": as_csv(rows), "json": as_json(rows)}
    if out is not None:
        _write(fresh_folder(out), tables, rows, firsts[0], next(iter(compared.values())))
    return tables


def as_text(rows: Sequence[Row]) -> str:
    """One aligned table a score: sequences down, detectors across, their mean last."""
    detectors = list(dict.fromkeys(row.detector for row in rows))
    sequences = list(dict.fromkeys(row.sequence for row in rows))
    found = {(row.sequence, row.detector): row.scores for row in rows}
    lines = []
    for score in rows[0].scores:
        values = np.array([[found[s, d][score] for d in detectors] for s in sequences])
        lines.append(f"{score:16}" + "".join(f"{name:>16}" for name in detectors))
        for name, line in zip([*sequences, "mean"], [*values, values.mean(axis=0)], strict=True):
            lines.append(f"{name:16}" + "".join(f"{value:16.3f}" for value in line))
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


def contact_sheet(image: Image, peer: Peer) -> Image:
    """The image and three changed copies with the strongest corners drawn, in a 2x2 picture."""
    named = changes()
    copies = [image, *(named[name](image)[0] for name in _SHEET)]
    drawn, flags = [], cv2.DRAW_MATCHES_FLAGS_DRAW_RICH_KEYPOINTS
    for copy in copies:
        points = peer.detect(copy)[:_SHEET_POINTS].to_cv2()
        drawn.append(cv2.drawKeypoints(copy, points, np.empty(0), (0, 200, 255), flags))
    return np.vstack([np.hstack(drawn[:2]), np.hstack(drawn[2:])])


def _write(folder: Path, tables: dict[str, str], rows: Sequence[Row], image: Image, peer: Peer) -> None:
    for form, name in {"text": "scores.txt", "csv": "scores.csv", "json": "scores.json"}.items():
        atomic_write(folder / name, tables[form])
    means: dict[str, list[float]] = {}
    score = next(iter(rows[0].scores))
    for row in rows:
        means.setdefault(row.detector, []).append(row.scores[score])
    averages = {name: float(np.nanmean(values)) for name, values in means.items()}
    drawing = figures.scores_figure(averages, f"mean {score}")
    atomic_write(folder / "scores.svg", figures.standalone(drawing))
    _, data = cv2.imencode(".png", contact_sheet(image, peer))
    atomic_write(folder / "corners.png", data.tobytes())
