"""What a calibration amounts to, in words and headline numbers."""

from __future__ import annotations

import math

import numpy as np

from facetcam.calibration.quality import MirrorDeviation, Validation
from facetcam.calibration.result import Calibration
from facetcam.rig.covariance import GLASS
from facetcam.viz.wording import BAD, FAIR, GOOD, plural

AGREE = 1.0  # pixels up to which two halves of a set agree
NOISE_RATIO = 1.6  # held-out error in noises above which the model misses something
_MOST_DIGITS = 9


def verdict(calibration: Calibration, validation: Validation | None) -> str:
    """Whether the rig can be trusted, and by how much, in one sentence."""
    photos = len({f.sighting.photo for f in calibration.sightings})
    corners = sum(int(np.count_nonzero(f.kept)) for f in calibration.sightings)
    base = f"{plural(photos, 'photo')} with {corners} corners fit to {pixels(calibration.rms())} (RMS)"
    parts = [base]
    if validation is not None and math.isfinite(validation.held_out_rms):
        parts.append(f"photos left out are predicted to {pixels(validation.held_out_rms)}")
    if validation is not None and math.isfinite(validation.split_half_rms):
        how = "agree to" if validation.split_half_rms <= AGREE else "differ by"
        parts.append(f"two halves of the set {how} {pixels(validation.split_half_rms)} over the views")
    doubts = doubts_of(calibration, validation)
    if doubts:
        return f"{'; '.join(parts)}; but {', and '.join(doubts)}."
    if validation is None:
        return f"{parts[0]}; how well photos left out are predicted was not tried."
    return f"Good to use: {'; '.join(parts)}."


def doubts_of(calibration: Calibration, validation: Validation | None) -> list[str]:
    """Reasons not to trust the rig as a whole."""
    doubts = []
    open_ = [u for u in calibration.unobservable if not u.harmless]
    if open_:
        things = "one thing that matters" if len(open_) == 1 else f"{len(open_)} things that matter"
        doubts.append(f"{things} could not be determined")
    if any(f.kind == "moved board" for f in calibration.findings):
        doubts.append("a board moved")
    if any(f.kind == "focus" for f in calibration.findings):
        doubts.append("the lens was not the same in all photos")
    if any(f.kind == "scale" for f in calibration.findings):
        doubts.append("the squares' size or the drawing is wrong")
    if validation is not None and validation.flatness is not None and not validation.flatness.flat:
        where = validation.flatness.worst_view
        doubts.append("the mirrors do not look flat" + (f" in '{where}'" if where else ""))
    expected = NOISE_RATIO * calibration.rms_of_noise
    if validation is not None and validation.split_half_rms > AGREE:
        doubts.append("where no corner was seen the lens and the mirrors are guessed")
    if validation is not None and validation.held_out_rms > expected:
        doubts.append("photos left out are predicted worse than noise explains")
    return doubts


def tiles(calibration: Calibration, validation: Validation | None) -> list[tuple[str, str, str]]:
    """Headline numbers: label, value, grade."""
    rejected = sum(int(np.count_nonzero(~f.kept)) for f in calibration.sightings)
    total = sum(len(f.sighting) for f in calibration.sightings)
    found = [("residual (RMS)", pixels(calibration.rms()), "")]
    if validation is not None:
        grade = GOOD if validation.held_out_rms <= NOISE_RATIO * calibration.rms_of_noise else FAIR
        found += _known("held-out photos", validation.held_out_rms, grade)
        found += _known("from one view to the others", validation.cross_view_rms, "")
        found += _known("the same, by the sigmas", validation.cross_view_expected, "")
        found += _known("between two halves", validation.split_half_rms, "")
        if validation.flatness is not None:
            flat = validation.flatness.flat
            found.append(("mirrors", "flat" if flat else "not flat", GOOD if flat else BAD))
    found.append(("corners rejected", f"{100 * rejected / max(total, 1):.1f}\u00a0%", ""))
    unknown = sum(not u.harmless for u in calibration.unobservable)
    harmless = len(calibration.unobservable) - unknown
    shown = f"{harmless}, harmless" if harmless and not unknown else str(unknown)
    found.append(("not determined", shown, BAD if unknown else GOOD))
    return found


def _known(label: str, value: float, grade: str) -> list[tuple[str, str, str]]:
    return [(label, pixels(value), grade)] if math.isfinite(value) else []


def pixels(value: float) -> str:
    """A length in pixels, to a thousandth where it is small."""
    return f"{value:.3f}\u00a0px" if value < 10 else f"{value:.0f}\u00a0px"


def number(value: float, digits: int) -> str:
    """A number, or a dash where there is none."""
    return f"{value:.{digits}f}" if math.isfinite(value) else "–"


def digits_of(sigma: float, least: int) -> int:
    """Digits after the point that show two of a sigma that count; `least` where it is large, or none."""
    if not (math.isfinite(sigma) and sigma > 0.0):
        return least
    return min(max(least, 1 - math.floor(math.log10(sigma))), _MOST_DIGITS)


def deviation_row(d: MirrorDeviation) -> list[str]:
    """A mirror's name, tilt and shift; nothing measured where the photos do not tell."""
    if not (math.isfinite(d.tilt_sigma_deg) or math.isfinite(d.shift_sigma_mm)):
        return [d.mirror, "as drawn: not determined", "as drawn: not determined"]
    n, m = digits_of(d.tilt_sigma_deg, 3), digits_of(d.shift_sigma_mm, 2)
    tilt = f"{d.tilt_deg:.{n}f}° ± {number(d.tilt_sigma_deg, n)}"
    return [d.mirror, tilt, f"{d.shift_mm:+.{m}f} mm ± {number(d.shift_sigma_mm, m)}"]


def camera_rows(calibration: Calibration) -> list[list[str]]:
    """Name, value and sigma of the parameters of the lens, and of the glass before mirrors."""
    p = calibration.parameters
    rows = []
    for name, unit, value, sigma in zip(p.names, p.units, p.value, p.sigma, strict=True):
        mirrors, _, word = name.rpartition(": ")
        if not mirrors or word in GLASS:
            digits = digits_of(float(sigma), 3 if unit else 5)
            shown = number(float(sigma), digits) if math.isfinite(sigma) else "not determined"
            label = f"glass of {mirrors}: {word}" if mirrors else name
            rows.append([label, f"{value:.{digits}f} {unit}".rstrip(), shown])
    return rows
