"""Photos of another camera among those of a rig: an explanation, and what it is worth."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from facetcam.calibration.evidence import (
    TIGHT,
    Explanation,
    is_mended,
    is_wrong,
    middle_error,
    misfit,
    snap,
    stations_only,
)
from facetcam.calibration.fit import Fit
from facetcam.calibration.result import Finding

Array = NDArray[np.float64]

_OTHER_FOCAL = 0.004  # share by which another camera's focal length differs
_LENS = 4  # focal lengths and principal point
_GAPS = 3  # between focal lengths of single photos at which the set may fall apart
_ROUNDS = 4  # of sorting photos by camera


def another_camera(fit: Fit, noise: float) -> Explanation | None:
    """Leave out the photos that another lens, solved for, fits far better.

    Every photo first has a focal length of its own; where those fall apart the photos are sorted by the
    camera that explains them better, and both are solved for, in turns.
    """
    sets = list(_apart(_focal_lengths(fit)))
    if not sets:
        return None
    others = min(sets, key=lambda photos: _quick_misfit(fit, photos, noise))
    for _ in range(_ROUNDS):
        rest = fit.of_photos([p for p in fit.photos if p not in others]).solved(10.0, 20).solved(TIGHT, 30)
        second = _with_another_lens(_with_rig(fit.of_photos(sorted(others)), rest))
        one, two = (misfit(stations_only(_with_rig(fit, by)), noise) for by in (rest, second))
        again = _smaller({p for p in fit.photos if two[p] < one[p]}, fit.photos)
        if again == others or not again:
            break
        others = again
    before = middle_error(stations_only(_with_rig(second, rest)))
    focal, usual = float(second.state.intrinsics[0]), float(rest.state.intrinsics[0])
    if (
        not is_wrong(before, noise)
        or not is_mended(before, middle_error(second), noise)
        or abs(focal / usual - 1.0) < _OTHER_FOCAL
    ):
        return None
    text = (
        f"photos {{photos}} fit only a focal length of {focal:.0f} px, the others {usual:.0f} px:"
        " another camera or zoom; they are left out"
    )
    cost = sum(sum(misfit(fit.solved(snap(noise)), noise).values()) for fit in (rest, second))
    return Explanation(rest, Finding("other camera", text, tuple(second.photos)), cost, _LENS)


def lens_of_their_own(fit: Fit, photos: Sequence[int], noise: float) -> float:
    """Misfit of some photos when they have a lens of their own, nats, its numbers paid for."""
    freed = _with_another_lens(fit.of_photos(photos)).solved(snap(noise))
    cost = 0.5 * _LENS * float(np.log(2 * len(fit.looks.pixels)))
    return cost + sum(misfit(freed, noise).values())


def _focal_lengths(fit: Fit) -> dict[int, float]:
    """The focal length that each photo alone asks for, the rig given; of photos that tie two sightings."""
    found = {}
    for photo in fit.photos:
        part = fit.of_photos([photo])
        if len(part.sightings) < 2:
            continue
        free = np.zeros(part.state.shared, dtype=bool)
        free[:2] = True
        freed = replace(part, free=free).solved(30.0, 10).solved(3.0, 10)
        found[photo] = float(freed.state.intrinsics[0])
    return found


def _apart(focal: dict[int, float]) -> Iterable[set[int]]:
    """The smaller parts into which gaps between focal lengths cut the photos, widest gap first."""
    photos = sorted(focal, key=lambda p: focal[p])
    gaps = np.diff(np.log([max(focal[p], 1.0) for p in photos]))
    for k in np.argsort(-gaps, kind="stable")[:_GAPS]:
        if gaps[k] > 0.5 * _OTHER_FOCAL:
            yield _smaller(set(photos[k + 1 :]), photos)


def _smaller(part: set[int], photos: Iterable[int]) -> set[int]:
    rest = set(photos) - part
    return part if len(part) <= len(rest) else rest


def _quick_misfit(fit: Fit, others: set[int], noise: float) -> float:
    """Misfit when these photos have a lens of their own, mirrors and boards left where they are."""
    parts = [sorted(others), [p for p in fit.photos if p not in others]]
    return sum(sum(misfit(_with_another_lens(fit.of_photos(p)), noise).values()) for p in parts)


def _with_another_lens(fit: Fit) -> Fit:
    """Solved for focal lengths, principal point and rig poses only: few photos tell nothing of distortion."""
    free = ~fit.lens_held & fit.free & (np.arange(len(fit.free)) < _LENS)
    return replace(fit, free=free).solved(30.0, 15).solved(3.0, 15).solved(TIGHT, 15)


def _with_rig(fit: Fit, like: Fit) -> Fit:
    """The fit with the lens, mirrors and boards of another."""
    state = replace(like.state, T_rig_station=fit.state.T_rig_station)
    return replace(fit, state=state)
