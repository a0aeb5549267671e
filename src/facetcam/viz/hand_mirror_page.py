"""The page of a board that was seen only in a mirror held by hand."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from facetcam.calibration import lens
from facetcam.calibration.hand_mirror import HandMirror
from facetcam.calibration.hand_mirror_checks import Sigma
from facetcam.calibration.result import FittedSighting
from facetcam.viz import calibration_figures as figures
from facetcam.viz.calibration_page import sentence
from facetcam.viz.calibration_words import number, pixels
from facetcam.viz.pages import embedded, write_page
from facetcam.viz.report import Picture
from facetcam.viz.wording import plural

Array = NDArray[np.float64]

_MOST = 12  # poses of the mirror whose residuals are drawn


@dataclass(frozen=True, slots=True)
class HandMirrorReport:
    """All the page shows; `photos` has a name for each pose, `distance` is to the middle of the board."""

    title: str
    found: HandMirror
    sigma: Sigma
    distance: float
    rms_apart: Array
    photos: Sequence[str]
    pictures: Sequence[Picture]
    warnings: Sequence[str]


def write_hand_mirror_report(report: HandMirrorReport, path: Path) -> None:
    """Write the page to `path`; raises `OutputError` when it cannot be written."""
    context = {
        "title": report.title,
        "verdict": verdict(report),
        "tiles": tiles(report),
        "notes": [sentence(warning) for warning in report.warnings],
        "residuals": Markup(residuals(report)),
        "pose": [[f"{value:+.6f}" for value in row] for row in report.found.T_cam_board],
        "lens": [[name, f"{value:.5f}"] for name, value in lens_of(report)],
        "photos": photo_rows(report),
        "pictures": [embedded(picture) for picture in report.pictures],
    }
    write_page("hand_mirror.html", path, context)


def verdict(report: HandMirrorReport) -> str:
    """Where the board is, and how well that is known, in one sentence."""
    found = f"The board's middle is {1000 * report.distance:.1f} mm from the camera"
    fits = f"{plural(len(report.photos), 'pose')} of the mirror fit to {pixels(report.found.rms)} (RMS)"
    if not math.isfinite(report.sigma.turn):
        return f"{found}; {fits}; how well that is known takes four poses or more."
    turn, shift = math.degrees(report.sigma.turn), 1000.0 * report.sigma.shift
    return f"{found}, known to {turn:.2f}° and {shift:.1f} mm (one sigma, from leaving poses out); {fits}."


def tiles(report: HandMirrorReport) -> list[tuple[str, str, str]]:
    """Headline numbers: label, value, grade."""
    kept = report.found.fit.kept
    return [
        ("turn, one sigma", f"{number(math.degrees(report.sigma.turn), 3)}°", ""),
        ("place, one sigma", f"{number(1000.0 * report.sigma.shift, 2)} mm", ""),
        ("residual (RMS)", pixels(report.found.rms), ""),
        ("each image by itself", pixels(float(np.sqrt(np.nanmean(report.rms_apart**2)))), ""),
        ("corners rejected", f"{100 * (1 - kept.mean()):.1f} %", ""),
    ]


def residuals(report: HandMirrorReport) -> str:
    """Residual vectors of the poses, spread over all where there are many."""
    fit, shown = report.found.fit, np.linspace(0, len(report.photos) - 1, min(len(report.photos), _MOST))
    fitted = []
    for i in np.unique(shown.round().astype(int)).tolist():
        a, b = fit.looks.bounds[i]
        sighting = replace(fit.sightings[i], view=report.photos[i])
        fitted.append(FittedSighting(sighting, sighting.pixels - fit.residuals[a:b], fit.kept[a:b]))
    return figures.residual_fields(tuple(report.photos), fitted)


def lens_of(report: HandMirrorReport) -> list[tuple[str, float]]:
    """Numbers of the lens."""
    camera = report.found.rig.camera
    return list(zip(lens.NAMES[camera.model], lens.values_of(camera).tolist()))


def photo_rows(report: HandMirrorReport) -> list[list[str]]:
    """Photo, corners, corners rejected, residual, residual by itself, and the mirror's pose."""
    fit, together = report.found.fit, report.found.pose_rms
    rows = []
    for i, name in enumerate(report.photos):
        a, b = fit.looks.bounds[i]
        mirror = report.found.rig.mirrors[f"pose{i + 1}"]
        normal = ", ".join(f"{n:+.3f}" for n in mirror.normal)
        rejected = int(np.count_nonzero(~fit.kept[a:b]))
        where = f"{1000 * mirror.offset:.1f} mm along ({normal})"
        rows.append(
            [name, str(b - a), str(rejected), number(together[i], 3), number(report.rms_apart[i], 3), where]
        )
    return rows
