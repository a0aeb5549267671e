"""Which corners and sightings are believed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from facetcam.calibration.boards import BoardSet
from facetcam.calibration.fit import Fit, looks_of
from facetcam.calibration.readings import readings_of
from facetcam.calibration.result import Finding
from facetcam.calibration.sightings import Sighting
from facetcam.calibration.start import is_mirrored, usable

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_SIGMAS = 4.0
RAYLEIGH = 1.1774  # median length of a vector of two unit normal coordinates
_LEAST_NOISE = 0.002  # pixels
_USUAL = 10.0
_WORST = 5.0  # spread of a sighting that is still believed
_STRANGE = 5.0  # pixels by which a sighting may be off before corners are rejected


def noise_of(fit: Fit) -> float:
    """Standard deviation of a corner coordinate in a usual sighting, from the middle of the residuals."""
    lengths = np.linalg.norm(fit.residuals, axis=1) / fit.looks.noise
    return max(float(np.median(lengths)) / RAYLEIGH, _LEAST_NOISE) if len(lengths) else _LEAST_NOISE


def believed(fit: Fit, sigma: float) -> Mask:
    """Mask of the corners that noise explains."""
    kept: Mask = np.linalg.norm(fit.residuals, axis=1) < _SIGMAS * sigma * fit.looks.noise
    return kept


def spread_of(fit: Fit, sigma: float) -> Array:
    """Noise (S,) of every sighting in units of `sigma`, from the middle of its residuals.

    What a sighting says of itself is blended with the usual, as if that had been seen in `_USUAL` coordinates
    of it; a station with few corners follows them, which is allowed for.
    """
    looks = fit.looks
    count = np.bincount(looks.sighting, minlength=len(looks.view)).astype(np.float64)
    at_station = np.bincount(looks.station, weights=count, minlength=len(fit.stations))
    free = np.maximum(2.0 * count - 6.0 * count / at_station[looks.station], 0.0)
    lengths = np.linalg.norm(fit.residuals, axis=1) / (RAYLEIGH * sigma)
    middle = np.array([np.median(lengths[a:b]) if b > a else 1.0 for a, b in looks.bounds])
    own = middle**2 * 2.0 * count  # sum of squares, without strays
    return np.minimum(np.sqrt((_USUAL + own) / (_USUAL + free)), _WORST)


def reviewed(fit: Fit, boards: BoardSet, sightings: Sequence[Sighting]) -> tuple[Fit, list[Sighting]]:
    """Give every sighting the view that explains it best now; also those that had none.

    Returns
    -------
    fit : Fit
    strange : list of Sighting
        Sightings that no view explains.
    """
    limit = max(_STRANGE, 10.0 * noise_of(fit))
    named, places, stations, strange = [], [], [], []
    moved = dict(fit.moved)
    known = {(s.photo, s.board) for s in fit.sightings}
    for s in sightings:
        reads = [
            replace(way, view=v)
            for way in readings_of(s, boards)
            for v in fit.views
            if _may(fit, way, v, boards)
        ]
        standings = _standings(fit, s, (s.photo, s.board) in known)
        tries = [(error_in_view(fit, boards, read, *at), read, *at) for at in standings for read in reads]
        best = min(tries, key=itemgetter(0), default=None)
        if best is None or best[0] > limit:
            strange.append(s)
            continue
        _, read, place, station = best
        named.append(read)
        places.append(place)
        stations.append(station)
        if fit.places != (-1,) and place != s.board:
            moved[s.photo, s.board] = place
    looks = looks_of(named, boards, fit.views, places, stations)
    kept = np.ones(len(looks.pixels), dtype=bool)
    return replace(fit, sightings=tuple(named), looks=looks, kept=kept, moved=moved), strange


def _standings(fit: Fit, sighting: Sighting, known: bool) -> list[tuple[int, int]]:
    """Places and station where a board may stand in a photo: any of its places while none is known."""
    standing = fit.place_of(sighting)
    if standing is None or known or fit.places == (-1,):
        return [] if standing is None else [standing]
    return [(place, standing[1]) for place, board in enumerate(fit.places) if board == sighting.board]


def _may(fit: Fit, sighting: Sighting, view: str, boards: BoardSet) -> bool:
    """Tell whether a sighting may be in a view: the one it was given, or one of its handedness."""
    if sighting.view is not None:
        return sighting.view == view
    mirrored = sighting.mirrored if sighting.mirrored is not None else is_mirrored(sighting, boards)
    return fit.nominal.is_flipped(view) == mirrored


def error_in_view(fit: Fit, boards: BoardSet, sighting: Sighting, place: int, station: int) -> float:
    """Median distance in pixels between where a sighting is and where its view would show it."""
    looks = looks_of([sighting], boards, fit.views, [place], [station])
    return float(np.median(np.linalg.norm(looks.pixels - fit.state.predict(looks), axis=1)))


def findings_of(strange: Sequence[Sighting], boards: BoardSet) -> tuple[Finding, ...]:
    """Say which sightings no view explains."""
    return tuple(
        Finding(
            "sighting rejected",
            f"photo {{photos}}: board '{boards.boards[s.board].name}' near"
            f" ({s.pixels[:, 0].mean():.0f}, {s.pixels[:, 1].mean():.0f}) fits no view of the rig",
            (s.photo,),
        )
        for s in strange
        if len(s)
    )


def without_place(fit: Fit, boards: BoardSet, sightings: Sequence[Sighting]) -> tuple[Finding, ...]:
    """Say which photos show boards that stand in no view of the rig, and are left out as a whole."""
    lost = {s.photo for s in sightings if usable(s, boards)} - set(fit.photos)
    if not lost:
        return ()
    text = (
        "photos {photos} show boards where no view of the rig could; they are left out:"
        " of another rig, or flipped by a program?"
    )
    return (Finding("photo rejected", text, tuple(sorted(lost))),)
