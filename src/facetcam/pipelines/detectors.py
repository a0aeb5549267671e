"""From images to tables, plots and a page that compare detectors."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from facetcam.errors import ConfigError, SourceError
from facetcam.evaluation import datasets as data
from facetcam.evaluation.detectors import Row, check_protocols, evaluate_change, evaluate_sequence
from facetcam.evaluation.peers import Peer, peers
from facetcam.evaluation.repeatability import Points, inside, warp
from facetcam.evaluation.synthetic import changes
from facetcam.evaluation.tables import as_csv, as_json, as_text, grid, means
from facetcam.features.images import Image
from facetcam.io.outputs import atomic_write, fresh_folder, require_absent
from facetcam.pipelines.progress import Progress, keeping, silent
from facetcam.viz import figures
from facetcam.viz.detectors_page import DetectorsReport, write_detectors_report
from facetcam.viz.pictures import captioned, draw_points
from facetcam.viz.report import Picture

_SHEET = ("scale 0.7", "rotation 30", "affine")  # beside the original, as in Fig. 12 of the paper
_SHEET_POINTS = 200
_SHEET_BORDER = 4.0  # pixels; nearer to the edge a changed copy has corners of its own
_PICTURE_WIDTH = 760


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
    """Compare detectors on image sequences and on changed images.

    Parameters
    ----------
    datasets : paths
        Folders of images in the Oxford or HPatches layout, or of one view under changing light; or folders of
        such folders. Image files are changed in known ways.
    out : path, optional
        Folder to make for `scores.txt`, `scores.csv`, `scores.json`, `scores.svg`, `corners.png` and
        `report.html`. The scores are written as they come.
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
        An unreadable folder or image, an unknown detector or protocol, or an output folder that exists.
    """
    if out is not None:
        require_absent(out)
    check_protocols(protocols)
    compared = peers(list(names) if names else None, enough=2 * top)
    sequences, photographs = _read(datasets)
    changed = [*photographs, *(data.read_grey(s.paths[0]) for s in sequences if synthetic)]
    named = _distinct(sequences)
    total = len(compared) * (len(sequences) + (len(changes()) if changed else 0))
    folder = None if out is None else fresh_folder(out)
    rows: list[Row] = []

    def finish(reason: str = "") -> None:
        if folder is not None and rows:
            image = photographs[0] if photographs else data.read_grey(sequences[0].paths[0])
            _write_pictures(folder, rows, image, compared, reason)

    with nullcontext() if folder is None else keeping(folder, finish):
        for row in _evaluated(compared, named, changed, protocols, top):
            rows.append(row)
            if folder is not None:
                _write_tables(folder, rows)
            progress(len(rows), total)
    finish()
    return {"text": as_text(rows), "csv": as_csv(rows), "json": as_json(rows)}


def _read(datasets: Sequence[Path | str]) -> tuple[list[data.Sequence], list[Image]]:
    """Sequences of the folders, every image of which can be read, and the images that are files."""
    paths = [Path(path) for path in datasets]
    if not paths:
        raise ConfigError("datasets: expected folders of images or image files, got none")
    if len(set(paths)) < len(paths):
        raise SourceError(f"{max(paths, key=paths.count)}: given twice; name each data set once")
    photographs = [data.read_grey(path) for path in paths if path.is_file()]
    sequences = [s for path in paths if not path.is_file() for s in data.find_sequences(path)]
    for sequence in sequences:
        sequence.images()  # better now than after an hour
    return sequences, photographs


def _distinct(sequences: list[data.Sequence]) -> list[data.Sequence]:
    """Sequences of one name, or of the name of a change, are called by their folder."""
    count = Counter([*(sequence.name for sequence in sequences), *changes()])
    return [s if count[s.name] == 1 else replace(s, name=str(s.paths[0].parent)) for s in sequences]


def _evaluated(
    compared: dict[str, Peer], sequences: list[data.Sequence], changed: list[Image], protocols: str, top: int
) -> Iterator[Row]:
    """One row of the tables after the other."""
    for name, peer in compared.items():
        for sequence in sequences:
            yield evaluate_sequence(sequence, name, peer, protocols, top)
        for change, function in changes().items() if changed else ():
            yield evaluate_change(changed, change, function, name, peer, protocols, top)


def contact_sheet(image: Image, peer: Peer) -> list[Picture]:
    """The image and three changed copies with the strongest corners, as in Fig. 12 of the paper."""
    named = changes()
    copies = [named[name](image) for name in _SHEET]
    changed = [_with_corners(name, *copy, peer) for name, copy in zip(_SHEET, copies, strict=True)]
    return [_with_corners("original", image, np.eye(3), peer), *changed]


def _with_corners(caption: str, image: Image, H: Points, peer: Peer) -> Picture:
    """The strongest corners in the part that the original shows; what a change had to make up is black."""
    size = image.shape[1], image.shape[0]
    points = peer.detect(image).xy
    back = np.asarray(np.linalg.inv(H), np.float64)
    points = points[inside(warp(back, points), size, _SHEET_BORDER)][:_SHEET_POINTS]
    shown = cv2.warpPerspective(np.ones_like(image), H, size, flags=cv2.INTER_NEAREST)
    return Picture(caption, image * shown, points, np.zeros(len(points), int))


def _write_tables(folder: Path, rows: Sequence[Row]) -> None:
    for form, table in {"txt": as_text, "csv": as_csv, "json": as_json}.items():
        atomic_write(folder / f"scores.{form}", table(rows))


def _write_pictures(
    folder: Path, rows: Sequence[Row], image: Image, compared: dict[str, Peer], reason: str
) -> None:
    score = next(iter(rows[0].scores))
    _, detectors, values = grid(rows, score)
    averages = dict(zip(detectors, np.nan_to_num(means(values)).tolist(), strict=True))
    ordered = dict(sorted(averages.items(), key=lambda item: -item[1]))
    drawing = figures.scores_figure(ordered, f"mean {score}")
    atomic_write(folder / "scores.svg", figures.standalone(drawing))
    first = detectors[0]
    sheet = [replace(p, caption=f"{first}, {p.caption}") for p in contact_sheet(image, compared[first])]
    drawn = [captioned(draw_points(p.image, p.points, p.views, _PICTURE_WIDTH), p.caption) for p in sheet]
    tiled = np.vstack([np.hstack(drawn[:2]), np.hstack(drawn[2:])])
    atomic_write(folder / "corners.png", cv2.imencode(".png", tiled)[1].tobytes())
    each = [_with_corners(name, image, np.eye(3), compared[name]) for name in detectors]
    sets = len({row.sequence for row in rows})
    title = f"{len(detectors)} detectors, {sets} {'set' if sets == 1 else 'sets'} of images"
    report = DetectorsReport(title, rows, sheet, each, reason)
    write_detectors_report(report, folder / "report.html")
