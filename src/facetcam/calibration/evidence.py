"""How well a solve explains its photos, on a scale by which explanations can be compared."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from facetcam.calibration.fit import Fit
from facetcam.calibration.least_squares import minimise
from facetcam.calibration.rejection import noise_of
from facetcam.calibration.result import Finding

Array = NDArray[np.float64]

TIGHT = 1.0  # pixels: the loss of a fit in which the majority snaps into place
CLEAR = 20.0  # nats by which one explanation must beat another to be believed before it
_SNAP = 10.0  # noises, if fewer: a wider loss finds a compromise of boards that moved by little
_WRONG = 5.0  # noises that a photo or board must be off to be looked into
LEAST = 0.5  # and pixels, while all causes are looked for
_MENDED = 0.4  # of its error must remain at most when it is explained


@dataclass(frozen=True, eq=False)
class Explanation:
    """What may be wrong with the photos, and how well they are explained by it.

    Attributes
    ----------
    fit : Fit
        To go on with.
    finding : Finding
    misfit : float
        Of all photos of the fit before, nats.
    numbers : int
        That it takes more than the fit before.
    """

    fit: Fit
    finding: Finding
    misfit: float
    numbers: int

    @property
    def price(self) -> float:
        """Misfit, and what its numbers must earn (Schwarz)."""
        return self.misfit + 0.5 * self.numbers * float(np.log(2 * max(len(self.fit.looks.pixels), 2)))


def misfit(fit: Fit, noise: float) -> dict[int, float]:
    """Minus the log likelihood of each photo, nats; heavy-tailed, so that no corner counts without bound."""
    squares = np.sum(fit.residuals**2, axis=1) / noise**2
    costs = 2.0 * np.log1p(0.5 * squares)  # Student's t of two degrees of freedom
    photos = np.array([s.photo for s in fit.sightings], dtype=np.int64)[fit.looks.sighting]
    return {p: float(costs[photos == p].sum()) for p in fit.photos}


def snap(noise: float) -> float:
    """Loss in pixels of the fits whose misfits are compared."""
    return min(TIGHT, _SNAP * noise)


def corner_noise(fit: Fit) -> float:
    """Noise of a corner coordinate in pixels when every sighting has a pose of its own.

    Boards that moved and photos of another camera, which spoil the joint fit, hardly touch it.
    """
    looks, state = fit.looks, fit.state
    alone = replace(looks, board=np.zeros_like(looks.board), station=np.arange(len(looks.station)))
    poses = state.T_rig_station[looks.station] @ state.T_station_board[looks.board]
    state = replace(state, T_station_board=np.eye(4)[None], T_rig_station=poses)
    held = np.zeros(state.shared, dtype=bool)
    for loss in (10.0, TIGHT):
        state = minimise(state, alone, held, fit.prior, loss, 10)
    spare = 1.0 - 6.0 * len(looks.station) / max(2.0 * len(looks.pixels), 1.0)
    return noise_of(replace(fit, looks=alone, state=state)) / float(np.sqrt(max(spare, 0.1)))


def is_wrong(error: float, noise: float, least: float = LEAST) -> bool:
    """Tell whether a median error in pixels is more than noise and small faults of the model."""
    return error > max(_WRONG * noise, least)


def is_mended(before: float, after: float, noise: float) -> bool:
    """Tell whether an explanation takes most of an error away."""
    return after < max(_MENDED * before, 2.0 * noise)


def middle_error(fit: Fit) -> float:
    """Median distance in pixels between where corners are and where they should be."""
    return float(np.median(np.linalg.norm(fit.residuals, axis=1)))


def sighting_errors(fit: Fit) -> Array:
    """The same of each sighting (S,); 0 without corners."""
    lengths = np.linalg.norm(fit.residuals, axis=1)
    return np.array([np.median(lengths[a:b]) if b > a else 0.0 for a, b in fit.looks.bounds])


def worst_sighting(fit: Fit) -> float:
    """The same of the sighting that fits worst."""
    return float(sighting_errors(fit).max(initial=0.0))


def stations_only(fit: Fit) -> Fit:
    """The fit with rig poses moved alone."""
    return replace(fit, free=np.zeros_like(fit.free)).solved(TIGHT, 8)
