"""The page of a calibration: verdict, figures, tables."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from facetcam.calibration.quality import Validation
from facetcam.calibration.result import Calibration, Finding, Unknown
from facetcam.viz import calibration_figures as figures
from facetcam.viz import calibration_words as words
from facetcam.viz.pages import embedded, write_page
from facetcam.viz.palette import view_colour
from facetcam.viz.pictures import data_uri, to_bgr8
from facetcam.viz.report import Picture

Array = NDArray[np.float64]

CROP = 24  # pixels to each side of a rejected corner
ENLARGED = 6
SEEN, PREDICTED = (74, 72, 229), (100, 200, 60)


@dataclass(frozen=True, slots=True)
class PhotoRow:
    """One photo as the table shows it: `blur` is the width of its edges in pixels, NaN where unknown."""

    name: str
    blur: float


@dataclass(frozen=True, slots=True)
class CalibrationReport:
    """All that the page shows."""

    title: str
    calibration: Calibration
    validation: Validation | None
    photos: Sequence[PhotoRow]
    warnings: Sequence[str] = ()
    pictures: Sequence[Picture] = ()  # photos with their corners
    outliers: Sequence[Picture] = ()  # crops round rejected corners
    facts: Mapping[str, str] = field(default_factory=dict)
    from_drawing: bool = True  # False when the views were found from the photos


def write_calibration_report(report: CalibrationReport, path: Path) -> None:
    """Write the page to `path`; raises `OutputError` when it cannot be written."""
    write_page("calibration.html", path, context_of(report))


def context_of(report: CalibrationReport) -> dict[str, Any]:
    """What the template is filled with."""
    calibration, validation = report.calibration, report.validation
    return {
        "title": report.title,
        "verdict": words.verdict(calibration, validation),
        "tiles": words.tiles(calibration, validation),
        "notes": notes_of(report),
        "figures": {name: Markup(svg) for name, svg in drawn(report).items()},
        "depth": f"{validation.maps[0].depth:.2g}" if validation and validation.maps else "",
        "deviations": deviations_of(report),
        "parameters": words.camera_rows(calibration),
        "glass": any(mirror.glass is not None for mirror in calibration.rig.mirrors.values()),
        "outliers": [{"caption": p.caption, "uri": data_uri(to_bgr8(p.image))} for p in report.outliers],
        "pictures": [embedded(picture) for picture in report.pictures],
        "view_legend": [(name, view_colour(i)) for i, name in enumerate(calibration.rig.view_names)],
        "photos": [photo_row(report, index) for index in range(len(report.photos))],
        "facts": report.facts,
    }


def deviations_of(report: CalibrationReport) -> list[list[str]]:
    """Rows of the table of mirrors; none where there was no drawing."""
    if report.validation is None or not report.from_drawing:
        return []
    return [words.deviation_row(d) for d in report.validation.deviations]


def notes_of(report: CalibrationReport) -> list[dict[str, str]]:
    """What the images could not tell, what was wrong with them, and what to do."""
    findings: list[Finding] = [*report.calibration.findings]
    if report.validation is not None:
        findings += report.validation.findings
    names = [photo.name for photo in report.photos]
    unknown: Sequence[Unknown] = report.calibration.unobservable
    notes = [
        {"grade": "" if u.harmless else "bad", "text": sentence(u.what), "advice": sentence(u.advice)}
        for u in unknown
    ]
    notes += [{"grade": "fair", "text": sentence(f.told(names)), "advice": ""} for f in findings]
    return notes + [{"grade": "fair", "text": sentence(w), "advice": ""} for w in report.warnings]


def sentence(text: str) -> str:
    """With a capital and a full stop."""
    return text and text[0].upper() + text[1:] + ("" if text.endswith((".", "!", "?")) else ".")


def drawn(report: CalibrationReport) -> dict[str, str]:
    """The figures for which there is data, by name."""
    calibration, validation = report.calibration, report.validation
    found = {"coverage": figures.coverage(calibration)}
    if any(f.kept.any() for f in calibration.sightings):
        found["residuals"] = figures.residual_fields(calibration.rig.view_names, calibration.sightings)
    if validation is not None and validation.maps:
        found["maps"] = figures.uncertainty_maps(validation.maps, calibration.rig.view_names)
    if len(report.photos) > 1:
        rms = [photo_rms(calibration, index) for index in range(len(report.photos))]
        found["photos"] = figures.residuals_by_photo(rms, validation.held_out if validation else {})
    return found


def photo_rms(calibration: Calibration, photo: int) -> float:
    """Root mean square residual of a photo's kept corners in pixels; NaN without any."""
    squares = [
        np.sum(f.residuals[f.kept] ** 2, axis=1) for f in calibration.sightings if f.sighting.photo == photo
    ]
    joined = np.concatenate([*squares, np.empty(0)])
    return float(np.sqrt(joined.mean())) if len(joined) else math.nan


def photo_row(report: CalibrationReport, index: int) -> dict[str, Any]:
    """A row of the table of photos; its residual is graded against the others."""
    calibration, photo = report.calibration, report.photos[index]
    fitted = [f for f in calibration.sightings if f.sighting.photo == index]
    seen: dict[str, list[str]] = {}
    for f in fitted:
        seen.setdefault(f.sighting.view or "?", []).append(calibration.boards.boards[f.sighting.board].name)
    rms, overall = photo_rms(calibration, index), calibration.rms()
    held = report.validation.held_out.get(index, math.nan) if report.validation else math.nan
    cells = [
        str(index),
        photo.name,
        "; ".join(f"{view}: {', '.join(names)}" for view, names in seen.items()) or "none used",
        str(sum(len(f.sighting) for f in fitted)),
        str(sum(int(np.count_nonzero(~f.kept)) for f in fitted)),
        words.number(rms, 3),
        words.number(held, 3),
        words.number(photo.blur, 1),
    ]
    grade = "bad" if rms > 2.0 * overall else "fair" if rms > 1.5 * overall else ""
    return {"cells": cells, "grade": grade}


def crop_of(image: NDArray[np.generic], seen: Array, predicted: Array, caption: str) -> Picture:
    """A rejected corner enlarged, where it was seen and where the rig predicts it."""
    middle = np.rint(seen).astype(int)
    padded = cv2.copyMakeBorder(to_bgr8(image), CROP, CROP, CROP, CROP, cv2.BORDER_REPLICATE)
    x, y = middle
    patch = padded[y : y + 2 * CROP + 1, x : x + 2 * CROP + 1]
    large = cv2.resize(patch, None, fx=ENLARGED, fy=ENLARGED, interpolation=cv2.INTER_CUBIC)
    for point, colour in ((predicted, PREDICTED), (seen, SEEN)):
        at = ((point - middle + CROP + 0.5) * ENLARGED - 0.5) * 16
        if np.all(np.abs(at) < 1e6):
            cv2.circle(
                large, tuple(np.rint(at).astype(int).tolist()), 16 * 14, colour, 3, cv2.LINE_AA, shift=4
            )
    return Picture(caption, np.asarray(large, np.uint8))
