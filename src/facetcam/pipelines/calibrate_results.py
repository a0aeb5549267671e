"""What a calibration writes: the rig, residuals, summary, exports and the report."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from facetcam.calibration.boards import BoardSet
from facetcam.calibration.quality import Validation
from facetcam.calibration.result import Calibration, FittedSighting
from facetcam.io.outputs import atomic_write
from facetcam.io.virtual_cameras import export_cameras
from facetcam.pipelines.photo_memory import Photo
from facetcam.pipelines.photos import SecondLook
from facetcam.pipelines.summary import to_json
from facetcam.viz.calibration_page import CalibrationReport, PhotoRow, crop_of, write_calibration_report
from facetcam.viz.report import Picture

OUTLIERS, PICTURES = 12, 4


@dataclass(frozen=True, slots=True)
class CalibrationSummary:
    """Numbers of a calibration, as written to `summary.json`; pixels, None where unknown."""

    photos: int
    sightings: int
    corners: int
    rejected: int
    rms: float
    rms_uncut: float
    noise: float
    alike: float
    held_out_rms: float | None
    cross_view_rms: float | None
    cross_view_expected: float | None
    split_half_rms: float | None
    not_determined: tuple[str, ...]
    findings: tuple[str, ...]
    warnings: tuple[str, ...]
    seconds: float


def write_rig(calibration: Calibration, photos: Sequence[Photo], folder: Path) -> None:
    """Write the rig, the residuals and the exported cameras into a fresh folder.

    Raises
    ------
    OutputError
        If a file cannot be written.
    """
    calibration.rig.save(folder / "rig.yaml")
    atomic_write(folder / "residuals.csv", residuals_csv(calibration.sightings, calibration.boards, photos))
    export_cameras(calibration.rig, folder / "export")


def write_report(
    calibration: Calibration,
    validation: Validation | None,
    photos: Sequence[Photo],
    second: SecondLook,
    folder: Path,
    warnings: Sequence[str],
    from_drawing: bool = True,
) -> None:
    """Write the summary and the page.

    Raises
    ------
    OutputError
        If one cannot be written.
    """
    summary = summarise(calibration, validation, photos, warnings)
    atomic_write(folder / "summary.json", to_json(summary))
    report = CalibrationReport(
        title=f"Rig of {len(calibration.rig.views)} views from {len(photos)} photos",
        calibration=calibration,
        validation=validation,
        photos=[PhotoRow(photo.path.name, photo.blur) for photo in photos],
        warnings=warnings,
        pictures=pictures_of(calibration, photos, second),
        outliers=outliers_of(calibration, photos, second),
        facts=facts_of(calibration, summary),
        from_drawing=from_drawing,
    )
    write_calibration_report(report, folder / "report.html")


def summarise(
    calibration: Calibration,
    validation: Validation | None,
    photos: Sequence[Photo],
    warnings: Sequence[str],
) -> CalibrationSummary:
    """The calibration in numbers."""
    corners = sum(len(f.sighting) for f in calibration.sightings)
    kept = sum(int(np.count_nonzero(f.kept)) for f in calibration.sightings)
    judged = (
        [
            validation.held_out_rms,
            validation.cross_view_rms,
            validation.cross_view_expected,
            validation.split_half_rms,
        ]
        if validation
        else [math.nan] * 4
    )
    return CalibrationSummary(
        photos=len(photos),
        sightings=len(calibration.sightings),
        corners=corners,
        rejected=corners - kept,
        rms=calibration.rms(),
        rms_uncut=calibration.rms(kept_only=False),
        noise=calibration.noise,
        alike=calibration.alike,
        held_out_rms=judged[0],
        cross_view_rms=judged[1],
        cross_view_expected=judged[2],
        split_half_rms=judged[3],
        not_determined=tuple(u.what for u in calibration.unobservable if not u.harmless),
        findings=tuple(f.told([p.path.name for p in photos]) for f in calibration.findings),
        warnings=tuple(warnings),
        seconds=calibration.seconds,
    )


def residuals_csv(fitted: Sequence[FittedSighting], boards: BoardSet, photos: Sequence[Photo]) -> str:
    """A row a corner: photo, board, corner, view, where seen, seen minus predicted (pixels), kept or not."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(["photo", "board", "corner", "view", "u", "v", "du", "dv", "kept"])
    for f in fitted:
        names = photos[f.sighting.photo].path.name, boards.boards[f.sighting.board].name
        for corner, (u, v), (du, dv), kept in zip(f.sighting.corners, f.sighting.pixels, f.residuals, f.kept):
            numbers = f"{u:.4f}", f"{v:.4f}", f"{du:.4f}", f"{dv:.4f}"
            table.writerow([*names, int(corner), f.sighting.view, *numbers, int(kept)])
    return text.getvalue()


def pictures_of(calibration: Calibration, photos: Sequence[Photo], second: SecondLook) -> list[Picture]:
    """A few photos, spread over the set, with the corners that were kept in the colour of their view."""
    names = list(calibration.rig.view_names)
    chosen = np.unique(np.linspace(0, len(photos) - 1, PICTURES).round().astype(int))
    pictures = []
    for index in chosen.tolist():
        fitted = [f for f in calibration.sightings if f.sighting.photo == index and f.sighting.view in names]
        points = np.concatenate([*(f.sighting.pixels[f.kept] for f in fitted), np.empty((0, 2))])
        views = [np.full(int(f.kept.sum()), names.index(str(f.sighting.view))) for f in fitted]
        caption = photos[index].path.name
        labels = np.concatenate([*views, np.empty(0, int)]).astype(int)
        pictures.append(Picture(caption, second.image(index), points, labels))
    return pictures


def outliers_of(calibration: Calibration, photos: Sequence[Photo], second: SecondLook) -> list[Picture]:
    """Crops round the rejected corners that are farthest off, at most two a photo."""
    found: list[tuple[float, FittedSighting, int]] = []
    for f in calibration.sightings:
        off = np.linalg.norm(f.residuals, axis=1)
        found += [(float(off[k]), f, int(k)) for k in np.flatnonzero(~f.kept & np.isfinite(off))]
    found.sort(key=lambda item: -item[0])
    crops, counts = list[Picture](), dict[int, int]()
    for off, f, k in found:
        photo = f.sighting.photo
        counts[photo] = counts.get(photo, 0) + 1
        if counts[photo] > 2 or len(crops) == OUTLIERS:
            continue
        caption = f"{photos[photo].path.name}, {f.sighting.view}: {off:.2f} px"
        crops.append(crop_of(second.image(photo), f.sighting.pixels[k], f.predicted[k], caption))
    return crops


def facts_of(calibration: Calibration, summary: CalibrationSummary) -> dict[str, str]:
    """Rows of the summary."""
    return {
        "photos, sightings": f"{summary.photos}, {summary.sightings}",
        "corners, rejected": f"{summary.corners}, {summary.rejected}",
        "RMS of corners kept": f"{summary.rms:.3f} px",
        "RMS of all corners": f"{summary.rms_uncut:.3f} px",
        "noise of a corner": f"{calibration.noise:.3f} px a coordinate",
        "sigmas": f"{calibration.alike:.2f} times those of corners that err independently",
        "boards": ", ".join(board.name for board in calibration.boards.boards)
        + (", fixed to each other" if calibration.boards.fixed else ""),
        "time of the solve": f"{calibration.seconds:.1f} s",
    }
