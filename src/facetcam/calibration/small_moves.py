"""Boards of a fixed set that moved by little: told by the noise of the solve, and by what is usual in it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from facetcam.calibration.boards import BoardSet
from facetcam.calibration.evidence import (
    CLEAR,
    LEAST,
    TIGHT,
    Explanation,
    corner_noise,
    is_wrong,
    misfit,
    snap,
    stations_only,
    worst_sighting,
)
from facetcam.calibration.fit import Fit
from facetcam.calibration.moved_boards import moved_board, standing, total
from facetcam.calibration.other_camera import lens_of_their_own
from facetcam.calibration.problem import linearise
from facetcam.calibration.rejection import noise_of
from facetcam.calibration.result import Finding

Array = NDArray[np.float64]

_LEAST = 0.1  # pixels that a board must be off
_MENDED = 0.2  # of the worst error that may remain at the new place
_STRAY = 4.0  # median errors of its sighting beyond which a corner is not asked
_CORNERS = 4  # that a board must show
_FEWEST = 3  # photos that tell what is usual
_USUAL = 0.75  # quantile of the photos: the others may show a further board that moved


def moved_a_little(fit: Fit, boards: BoardSet) -> tuple[Fit, tuple[Finding, ...]]:
    """Give boards that moved by little further places, one after another."""
    findings: list[Finding] = []
    for _ in range(len(boards.boards) if boards.fixed else 0):
        tight = fit.solved(snap(corner_noise(fit)), 20)
        noise = max(corner_noise(tight), noise_of(tight))
        best = moved_board(tight, boards, noise, _LEAST)
        if best is None or not _stands_out(tight, best, noise):
            break
        findings.append(best.finding)
        fit = best.fit
    return fit, tuple(findings)


def _stands_out(before: Fit, best: Explanation, noise: float) -> bool:
    """Tell whether a second place explains what nothing else does.

    One photo alone may have crept, and a few may have been taken with another focus. Bent paper and a lens
    that is not quite its model set boards apart in the other photos, too: as much widens the noise.
    """
    place = len(best.fit.places) - 1
    photos = sorted({photo for (photo, _), at in best.fit.moved.items() if at == place})
    wrong, left = (worst_sighting(stations_only(fit.of_photos(photos))) for fit in (before, best.fit))
    least = _LEAST if len(photos) > 1 else LEAST
    if not is_wrong(wrong, noise, least) or left > max(_MENDED * wrong, 2.0 * noise):
        return False
    others = best.fit.of_photos([p for p in best.fit.photos if p not in photos])
    noise *= float(np.sqrt(overdispersion(others, noise)))
    old, new = misfit(before, noise), misfit(best.fit, noise)
    price = 0.5 * best.numbers * float(np.log(2 * len(before.looks.pixels)))
    gain = sum(old.values()) - sum(new.values())
    over_lens = lens_of_their_own(before, photos, noise) - sum(new[p] for p in photos)
    return min(gain, over_lens) - price > CLEAR


def put_back(fit: Fit, boards: BoardSet, findings: Sequence[Finding]) -> tuple[Fit, tuple[Finding, ...]]:
    """Undo moves that chance explains once wrong sightings are gone, which had made them up.

    Parameters
    ----------
    fit : Fit
        Solved, without sightings that fit no view.
    findings : sequence of Finding
        Its moved boards in the order of their places.
    """
    told, noise = list(findings), corner_noise(fit)
    moves = [f for f in findings if f.kind == "moved board"]
    for place, finding in enumerate(moves, start=len(boards.boards)):
        wider = noise * float(np.sqrt(overdispersion(fit, noise)))
        if np.isfinite(wider):
            back = _without_place(fit, place)
            old, new = (total(f.solved(TIGHT).solved(snap(wider)), wider) for f in (back, fit))
            if old - new < 3.0 * float(np.log(2 * len(fit.looks.pixels))) + CLEAR:
                fit = back.solved(TIGHT)
                told.remove(finding)
    return fit, tuple(told)


def _without_place(fit: Fit, place: int) -> Fit:
    """The fit with a board that moved put back to where it stands otherwise."""
    board = fit.places[place]
    photos = [photo for (photo, _), at in fit.moved.items() if at == place]
    back = standing(fit, board, dict.fromkeys(photos, board))
    first = fit.state.first_board + 6 * place
    held = (np.arange(fit.state.shared) >= first) & (np.arange(fit.state.shared) < first + 6)
    return replace(back, free=back.free & ~held)


def overdispersion(fit: Fit, noise: float) -> float:
    """By how much boards stand further apart in a usual photo than noise has it, as a ratio of squares.

    In each photo that shows several boards, a pose of its own for each is compared with one for all
    (Wedderburn 1974, "Quasi-likelihood functions"). At least 1; infinite where too few photos tell.
    """
    ratios = list(_ratios(fit, noise))
    return max(1.0, float(np.quantile(ratios, _USUAL))) if len(ratios) >= _FEWEST else np.inf


def _ratios(fit: Fit, noise: float) -> Iterator[float]:
    looks, residual, asked = fit.looks, fit.residuals, _asked(fit, noise)
    by_pose = linearise(fit.state, looks).station
    station, board = looks.station[looks.sighting], looks.board[looks.sighting]
    for p in range(len(fit.stations)):
        here = asked & (station == p)
        seen = [np.flatnonzero(here & (board == b)) for b in np.unique(board[here])]
        seen = [rows for rows in seen if len(rows) >= _CORNERS]
        if len(seen) > 1:
            whole, freedom = np.concatenate(seen), 6 * (len(seen) - 1)
            apart = sum(_taken(by_pose[rows], residual[rows]) for rows in seen)
            apart -= _taken(by_pose[whole], residual[whole])
            yield apart / (noise**2 * float(chi2.median(freedom)))


def _asked(fit: Fit, noise: float) -> NDArray[np.bool_]:
    """Mask of the corners that are not far from the others of their sighting."""
    lengths = np.linalg.norm(fit.residuals, axis=1)
    middle = np.array([np.median(lengths[a:b]) if b > a else 0.0 for a, b in fit.looks.bounds])
    asked: NDArray[np.bool_] = lengths < _STRAY * np.maximum(middle, noise)[fit.looks.sighting]
    return asked


def _taken(by_pose: Array, residual: Array) -> float:
    """Sum of squares that a pose takes out of residuals."""
    Q = np.linalg.qr(by_pose.reshape(-1, 6))[0]
    return float(np.sum((Q.T @ residual.ravel()) ** 2))
