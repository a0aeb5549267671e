"""Photos of another camera or focus, and boards of a fixed set that moved: found, named and worked round."""

from __future__ import annotations

from collections.abc import Sequence

from facetcam.calibration.boards import BoardSet
from facetcam.calibration.evidence import (
    CLEAR,
    TIGHT,
    Explanation,
    corner_noise,
    is_wrong,
    misfit,
    sighting_errors,
    snap,
    worst_sighting,
)
from facetcam.calibration.fit import Fit
from facetcam.calibration.focus import in_one_focus, other_focus
from facetcam.calibration.moved_boards import moved_board
from facetcam.calibration.other_camera import another_camera
from facetcam.calibration.result import Finding
from facetcam.calibration.small_moves import moved_a_little
from facetcam.errors import FacetcamError

_FEWEST = 6  # photos with several boards, from which a majority is asked for
_NEARLY_ALL = 0.8


def without_intruders(fit: Fit, boards: BoardSet) -> tuple[Fit, tuple[Finding, ...]]:
    """Explain photos that do not fit, one cause after another, by what they fit best.

    Every cause is solved for: photos that another camera took, a board that stands elsewhere in some photos.
    The one that leaves the least misfit, its numbers paid for, is believed; then the rest is looked at.

    Returns
    -------
    fit : Fit
        Without the photos of other cameras, and with further places for boards that moved.
    findings : tuple of Finding

    Raises
    ------
    FacetcamError
        If next to no photo fits the others: there is no majority to go by.
    """
    findings: list[Finding] = []
    if boards.fixed:
        _require_majority(fit.solved(TIGHT))
    for _ in range(1 + len(boards.boards)):
        tight = fit.solved(TIGHT)
        noise = corner_noise(tight)
        if not is_wrong(worst_sighting(tight), noise):
            break
        best = _best_explanation((fit, tight), boards, noise)
        if best is None or best.price > sum(misfit(tight.solved(snap(noise)), noise).values()) - CLEAR:
            break
        if best.finding.kind != "other camera" and _is_explained_by_focus(tight, noise, best.price):
            break
        findings.append(best.finding)
        fit = best.fit.solved(10.0)
    fit, focus, one = in_one_focus(fit.solved(TIGHT))
    # Boards seem to stand apart where the focal length differs, though none moved.
    fit, small = moved_a_little(fit, boards) if one else (fit, ())
    return fit, (*findings, *focus, *small)


def _is_explained_by_focus(fit: Fit, noise: float, price: float) -> bool:
    focus = other_focus(fit, noise)
    return focus is not None and focus.price < price


def _require_majority(fit: Fit) -> None:
    wrong, noise = sighting_errors(fit), corner_noise(fit)
    boards_in = {p: {s.board for s in fit.sightings if s.photo == p} for p in fit.photos}
    tied = {p for p, seen in boards_in.items() if len(seen) > 1}
    odd = tied & {s.photo for s, error in zip(fit.sightings, wrong) if is_wrong(float(error), noise)}
    if len(tied) >= _FEWEST and len(odd) > _NEARLY_ALL * len(tied):
        raise FacetcamError(
            f"calibration: in {len(odd)} of {len(tied)} photos the boards do not stand as in the others; if"
            " they are not fixed to each other say 'fixed: false' in boards.yaml,"
            " else check that the rig file fits"
        )


def _best_explanation(starts: Sequence[Fit], boards: BoardSet, noise: float) -> Explanation | None:
    """The cause that explains most, seen from where the majority rules, or from the compromise of all.

    With few photos the one, with many intruders the other lies too far off to see it.
    """
    best: Explanation | None = None
    for fit in starts:
        for cause in (another_camera(fit, noise), moved_board(fit, boards, noise) if boards.fixed else None):
            if cause is not None and (best is None or cause.price < best.price):
                best = cause
        if best is not None and not is_wrong(worst_sighting(best.fit), noise):
            break
    return best
