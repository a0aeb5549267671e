"""The page of a design: figures, and tables in the units of a workshop (mm, degrees, percent)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from markupsafe import Markup

from facetcam.design.analysis import Analysis, ViewFacts
from facetcam.design.optimal import OptimalCamera, first_mirror
from facetcam.design.search import BASELINE_UNIT, RESOLUTION_UNIT, Found, Qualities
from facetcam.design.spec import GOALS, DesignSpec
from facetcam.design.tolerance import ToleranceReport
from facetcam.viz import design_figures, mirror_images, rig_figures
from facetcam.viz.design_words import azimuths, degrees, facts, mm, percent, place
from facetcam.viz.pages import write_page

_LISTED = 8  # parasitic paths named in the table


@dataclass(frozen=True, slots=True)
class DesignReport:
    """All that the page of a design shows; `optimum` names cameras, `files` (name, what it is)."""

    title: str
    spec: DesignSpec
    analysis: Analysis
    optimum: dict[str, OptimalCamera]
    tolerance: ToleranceReport | None = None
    found: Found | None = None
    files: Sequence[tuple[str, str]] = field(default_factory=tuple)


def write_design_report(report: DesignReport, path: Path) -> None:
    """Write the page of a design to `path`; raises `OutputError` when it cannot be written."""
    write_page("design.html", path, design_context(report))


def design_context(report: DesignReport) -> dict[str, Any]:
    analysis, spec = report.analysis, report.spec
    return {
        "title": report.title,
        "verdict": verdict(analysis),
        "sees_horizon": analysis.horizon > 0.0,
        "tiles": tiles(report),
        "facts": facts(analysis.rig, spec),
        "figures": figures(report),
        "views": {"head": VIEW_HEAD, "rows": [view_row(n, v) for n, v in analysis.views.items()]},
        "dead": [(cause, percent(share)) for cause, share in analysis.sensor.dead().items()],
        "parasites": [(path, percent(s)) for path, s in list(analysis.sensor.parasites.items())[:_LISTED]]
        or [("none", "")],
        "seams": [
            (s.view, f"{mm(s.nearest)} to {mm(s.farthest)}", f"{s.narrowest:.1f} to {s.widest:.1f} px")
            for s in analysis.seams
        ],
        "seam_words": f"At f/{spec.optics.f_number:g}, in focus at {spec.optics.focus:g} m, pixels of "
        f"{spec.optics.pixel_um:g} µm: two views mix along an edge in a band f A |1/z - 1/z_focus| wide. "
        "Mask half of it on either side.",
        "wedges": [
            (
                " and ".join(w.views),
                f"{math.degrees(w.beta):.1f}°",
                f"{math.degrees(w.angle.min()):.1f}° to {math.degrees(w.angle.max()):.1f}°",
                "blind" if w.blind else "seen by both",
            )
            for w in analysis.wedges
        ],
        "optimum": [
            (
                words,
                f"{c.focal:.0f} px",
                f"{math.degrees(c.turned_from(analysis.rig.T_rig_cam)):.1f}°",
                mm(float(c.T_rig_cam[2, 3])),
            )
            for words, c in report.optimum.items()
        ],
        "tolerance": tolerance_context(report),
        "search": search_context(report.found),
        "files": report.files,
    }


def verdict(analysis: Analysis) -> str:
    """What the rig sees, and that it has no single view point, in plain words."""
    count = len(analysis.views)
    seen = f"{count} view{'s' if count > 1 else ''} see{'' if count > 1 else 's'}"
    words = (
        f"{seen} {percent(analysis.horizon)} of the horizon and {percent(analysis.sphere)} of all directions"
    )
    twice = (
        f", {percent(analysis.overlap)} twice or more"
        if analysis.overlap > 0.0005
        else "; no direction twice"
    )
    words += f"{twice if count > 1 else ''}."
    if any(mirror.glass is not None for mirror in analysis.rig.mirrors.values()):
        words += " Mirrors behind glass count as thin here, their silver in the plane where light enters."
    if count == 1:
        return words
    if analysis.spread < 1e-6:
        return f"{words} All views share one centre: a single view point."
    return (
        f"{words} Each view has one centre, but they lie up to {mm(analysis.spread)} apart "
        f"({mm(analysis.spread_rms)} root mean square about their mean): the rig is a generalised camera, "
        "not one single view point."
    )


def tiles(report: DesignReport) -> list[tuple[str, str]]:
    analysis = report.analysis
    found = [
        ("of the horizon", percent(analysis.horizon)),
        ("of the sphere", percent(analysis.sphere)),
        ("of the sensor in use", percent(sum(v.sensor_share for v in analysis.views.values()))),
        ("pixels per degree", f"{max(v.per_degree[1] for v in analysis.views.values()):.1f}"),
    ]
    if len(analysis.views) > 1:
        found.append(("between view centres, at most", mm(analysis.spread)))
    if report.optimum:
        found.append(("longest focal length here", f"{next(iter(report.optimum.values())).focal:.0f} px"))
    return found


def figures(report: DesignReport) -> dict[str, Markup]:
    analysis, spec = report.analysis, report.spec
    drawing = facts(analysis.rig, spec)  # stands beside the rig, and should be as high
    drawn = {
        "rig": rig_figures.rig_figure(analysis, spec.body, min(5.6, 0.42 * len(drawing) + 0.5)),
        "side": rig_figures.side_figure(analysis, spec.family, 1),
        "front": rig_figures.side_figure(analysis, spec.family, 0),
        "sensor": design_figures.sensor_figure(analysis),
        "density": design_figures.density_figure(analysis),
        "sphere": design_figures.sphere_figure(analysis),
    }
    if analysis.sensor.amid:
        drawn["strays"] = rig_figures.stray_figure(analysis, spec.body)
    if report.optimum:
        best = next(iter(report.optimum.values())).focal
        target = first_mirror(analysis.rig)
        drawn["projection"] = mirror_images.projection_figure(analysis.rig, target, best)
        drawn["variation"] = mirror_images.variation_figure(analysis.rig)
    if report.tolerance is not None:
        drawn["tolerance"] = design_figures.tolerance_figure(report.tolerance)
    return {name: Markup(svg) for name, svg in drawn.items()}


VIEW_HEAD = (
    "view", "over", "mirrored", "solid angle", "of the sphere", "of the sensor", "azimuth", "elevation",
    "pixels per degree", "centre x, y, z", "to the nearest",
)  # fmt: skip


def view_row(name: str, view: ViewFacts) -> tuple[str, ...]:
    return (
        name,
        " > ".join(view.chain) or "direct",
        "yes" if view.mirrored else "no",
        f"{view.solid_angle:.3f} sr",
        percent(view.solid_angle / (4 * math.pi)),
        percent(view.sensor_share),
        azimuths(view.azimuth),
        degrees(view.elevation),
        "{:.1f} to {:.1f}".format(*view.per_degree[::2]),
        place(view.centre),
        "" if math.isnan(view.baseline) else mm(view.baseline),
    )


def tolerance_context(report: DesignReport) -> dict[str, Any] | None:
    result, given = report.tolerance, report.spec.tolerance
    if result is None:
        return None
    before, after = ((e**2).mean(axis=0) ** 0.5 for e in (result.before, result.after))
    words = (
        f"{len(result.before)} builds with mirrors tilted by {given.tilt_arcmin:g}' and moved by "
        f"{given.offset_mm:g} mm, bowed by {given.bow_um:g} µm, edges cut to {given.cut_mm:g} mm, the camera "
        f"placed to {given.camera_mm:g} mm and {given.camera_arcmin:g}' (standard deviations); each "
        f"calibrated from image points good to {given.noise_px:g} px. "
        "Calibration fits planes, so it cannot remove the bow, nor what noise hides."
    )
    rows = [
        (n, f"{b:.2f} px", f"{a:.3f} px", percent(r), f"{s:.1f} px")
        for n, b, a, r, s in zip(result.views, before, after, result.removed, result.seam_shift)
    ]
    rules = [
        (s.view, s.error, f"{s.pixels:.3f} px", "" if s.rule is None else f"{s.rule:.3f} px")
        for s in result.sensitivities
    ]
    return {"words": words, "rows": rows, "rules": rules, "depth": f"{result.depth:g} m"}


def search_context(found: Found | None) -> dict[str, Any] | None:
    if found is None:
        return None
    goal = found.spec.search.goal
    wished = " + ".join(f"{getattr(goal, n):g} {n}" for n in GOALS if getattr(goal, n))
    box = " x ".join(f"{1e3 * side:.0f}" for side in found.spec.search.envelope)
    words = f"{found.evaluations} candidates inside {box} mm, for the most of {wished}. "
    if goal.resolution or goal.baseline:
        words += f"({RESOLUTION_UNIT:g} pixels per degree, or {mm(BASELINE_UNIT)}, count as full coverage.) "
    if found.start is None:
        words += "The design that it began with does not fit."
    named: list[tuple[str, Qualities | None]] = [("start", found.start), ("best", found.best)]
    rows = [
        (
            words_of,
            f"{q.score(goal):.4f}",
            percent(q.coverage),
            f"{q.resolution:.1f}",
            mm(q.baseline),
            percent(q.overlap),
        )
        for words_of, q in named
        if q is not None
    ]
    head = ("", "score", "coverage", "pixels per degree", "baseline", "overlap")
    return {"words": words, "head": head, "rows": rows, "figure": Markup(design_figures.search_figure(found))}
