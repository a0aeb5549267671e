"""Before the solve: what these photos can determine, and which ones to add."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from facetcam.calibration.boards import BoardSet
from facetcam.calibration.covariance import Knowledge, knowledge
from facetcam.calibration.fit import Fit, Tolerance
from facetcam.calibration.observability import unknowns
from facetcam.calibration.rejection import noise_of
from facetcam.calibration.result import Preflight
from facetcam.calibration.sightings import Sighting
from facetcam.calibration.solve import started
from facetcam.calibration.uncertainty import uncertainty_maps
from facetcam.rig import Rig

Array = NDArray[np.float64]

_NOISE = 0.1  # pixels that a corner is usually good to
_FEW_PHOTOS = 3  # a view
_FEW_TILTS = 10.0  # degrees over which boards must turn
_COVERED = 0.4  # share of a view that boards should reach


def preflight(
    rig: Rig, boards: BoardSet, sightings: Sequence[Sighting], tolerance: Tolerance | None = None
) -> Preflight:
    """Tell what a solve of these sightings could determine.

    The views are found and everything is placed as in a solve, only coarsely; then the information of the
    photos is looked at, not their fit.

    Raises
    ------
    FacetcamError
        If no sighting can be used; see `solve`.
    """
    fit = started(rig, boards, sightings, tolerance or Tolerance())
    for loss in (100.0, 10.0):
        fit = fit.solved(loss, 20, fit.lens_held).solved(loss, 20)
    known = knowledge(fit, max(_NOISE, min(noise_of(fit), 1.0)), settled=False)
    found = unknowns(fit, known, boards)
    counts = {v: sum(s.view == v for s in fit.sightings) for v in rig.views}
    advice = [u.advice for u in found if u.advice] + _weak_coverage(fit)
    return Preflight(
        enough=not any(not u.harmless for u in found),
        unobservable=found,
        advice=tuple(dict.fromkeys(advice)),
        sightings=counts,
        expected=_expected(fit, known),
    )


def _weak_coverage(fit: Fit) -> list[str]:
    """Photos that would help although nothing is open."""
    advice = []
    for view, name in enumerate(fit.views):
        rows = np.flatnonzero(fit.looks.view == view)
        photos = {fit.sightings[i].photo for i in rows}
        if len(photos) < _FEW_PHOTOS:
            advice.append(
                f"add photos with a board in view '{name}' (so far {len(photos)}; {_FEW_PHOTOS} are good)"
            )
        elif _reached(fit, view) < _COVERED:
            advice.append(
                f"boards reach {_reached(fit, view):.0%} of view '{name}'; show them nearer its edges"
            )
    if len(fit.photos) > 1 and _turned(fit) < _FEW_TILTS:
        advice.append("all photos show the boards from one side; turn the rig or the boards between photos")
    return advice


def _reached(fit: Fit, view: int) -> float:
    """Share of a view's pixels, in coarse cells, that hold a corner."""
    cell = max(fit.nominal.size) / 16
    labels = fit.nominal.labels()
    v, u = np.nonzero(labels == fit.nominal.view_names.index(fit.views[view]))
    whole = {tuple(c) for c in (np.stack([u, v], axis=1) // cell).astype(int).tolist()}
    seen = fit.looks.pixels[fit.looks.view[fit.looks.sighting] == view]
    return len({tuple(c) for c in (seen // cell).astype(int).tolist()} & whole) / max(len(whole), 1)


def _turned(fit: Fit) -> float:
    """Largest angle in degrees between board normals as the camera sees them."""
    rig = fit.nominal
    normals = []
    for s, b, p in zip(fit.sightings, fit.looks.board, fit.looks.station):
        T = fit.state.T_rig_station[p] @ fit.state.T_station_board[b]
        normals.append((rig.T_rig_image(s.view or "")[:3, :3].T @ T[:3, :3])[:, 2])
    cosine = np.clip(np.array(normals) @ np.array(normals).T, -1.0, 1.0)
    return float(np.degrees(np.arccos(cosine.min())))


def _expected(fit: Fit, known: Knowledge) -> dict[str, str]:
    """Sigmas that a solve would reach, in words, at the usual noise of a corner."""
    sigma = dict(zip((known.names[i] for i in known.free), known.sigma))

    def worst(ending: str, factor: float, unit: str) -> str:
        values = [s for name, s in sigma.items() if name.endswith(ending)]
        if not values or np.any(np.isnan(values)):
            return "not determined" if values else "held"
        return f"{_two_digits(factor * max(values))} {unit}"

    maps = [np.nanmedian(m.sigma_px) for m in uncertainty_maps(fit, known) if np.any(np.isfinite(m.sigma_px))]
    return {
        "focal length": worst("fx", 1.0, "px"),
        "mirror tilt": worst("tilt u", float(np.degrees(1.0)), "deg"),
        "mirror shift": worst("shift", 1e3, "mm"),
        "projection in the worst view": f"{_two_digits(max(maps))} px" if maps else "not determined",
    }


def _two_digits(value: float) -> str:
    """A number with two digits that count, without an exponent."""
    return f"{float(f'{value:.2g}'):g}" if value < 1e6 else f"{value:.0e}"
