"""What a report says of a run: its verdict in one sentence and its headline numbers."""

from __future__ import annotations

import math

from facetcam.viz.report import SlamReport

BAD, FAIR, GOOD = "bad", "fair", "good"


def verdict(report: SlamReport) -> str:
    """Tracked share, scale and error of a run in plain words."""
    frames = len(report.times)
    if frames == 0:
        return opened(report, "no frame was read.")
    if report.tracked == 0:
        return opened(report, f"none of {plural(frames, 'frame')} could be tracked, so there is no path.")
    parts = [tracked_words(report), scale_words(report)]
    if report.truth is not None:
        parts.append(
            f"the path is {length(report.truth.ate)} off the truth (root mean square), "
            f"{length(report.truth.ate_scaled)} when scale is fitted too"
        )
    return opened(report, "; ".join(parts) + ".")


def opened(report: SlamReport, sentence: str) -> str:
    """The sentence with a capital, or after the words that the run was interrupted."""
    if not report.interrupted:
        return sentence[0].upper() + sentence[1:]
    return f"Interrupted ({report.interrupted}) after {plural(len(report.times), 'frame')}: {sentence}"


def tracked_words(report: SlamReport) -> str:
    frames = len(report.times)
    where = f" in {1 + len(report.apart)} maps that never met" if report.apart else ""
    if report.tracked >= frames:
        return f"every one of {plural(frames, 'frame')} was tracked{where}"
    return f"{report.tracked} of {plural(frames, 'frame')} were tracked{where} ({share(report)})"


def scale_words(report: SlamReport) -> str:
    if report.metric:
        return f"lengths are METRIC, known to {percent(report.scale_sigma)} (1 sigma)"
    if report.rig_denied:
        return "lengths are NOT METRIC: the rig does not fit the film"
    if math.isfinite(report.scale_sigma):
        return f"lengths are NOT METRIC, known only to {percent(report.scale_sigma)} (1 sigma)"
    return "lengths are NOT METRIC: nothing in the film fixed the scale"


def tiles(report: SlamReport) -> list[tuple[str, str, str]]:
    """Headline numbers: label, value, and a grade for its colour (empty for none)."""
    frames = len(report.times)
    ratio = report.tracked / frames if frames else 0.0
    grade = GOOD if ratio >= 0.95 else FAIR if ratio >= 0.5 else BAD
    sigma = f"± {percent(report.scale_sigma)}" if math.isfinite(report.scale_sigma) else "unknown"
    found = [
        ("tracked", share(report), grade),
        ("scale, METRIC" if report.metric else "scale, NOT METRIC", sigma, GOOD if report.metric else FAIR),
    ]
    if report.truth is not None:
        found.append(("path error", length(report.truth.ate), ""))
        found.append(("error, scale fitted", length(report.truth.ate_scaled), ""))
    found.append(("keyframes", f"{len(report.keyframes)}", ""))
    found.append(("map points", f"{len(report.cloud)}", ""))
    return found


def share(report: SlamReport) -> str:
    """The tracked share in percent, rounded down so that 100 % means every frame."""
    frames = len(report.times)
    return f"{math.floor(1000 * report.tracked / frames) / 10:g} %" if frames else "0 %"


def percent(fraction: float) -> str:
    return f"{100 * fraction:.2g} %" if fraction < 0.995 else f"{100 * fraction:.0f} %"


def length(metres: float) -> str:
    if metres < 1e-3:
        return f"{1e3 * metres:.1f} mm"
    return f"{100 * metres:.1f} cm" if metres < 1.0 else f"{metres:.2f} m"


def plural(count: int, noun: str) -> str:
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"
