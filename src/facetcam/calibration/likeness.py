"""What the corners of one photo have in common beyond its pose, and how much less they tell for it.

Paper that is not flat or a mirror that crept shifts many corners of a photo alike. The usual covariance takes
each for an independent witness; here every photo is one (Liang and Zeger 1986, "Longitudinal data analysis
using generalized linear models": the sandwich estimator). A few photos tell little of a large covariance: it
is drawn towards a common factor as far as they disagree (Ledoit and Wolf 2004, "A well-conditioned estimator
for large-dimensional covariance matrices").
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from facetcam.calibration.fit import Fit
from facetcam.calibration.least_squares import normal_equations, restricted

Array = NDArray[np.float64]

_LEAST = 0.05  # of a direction that is left when a photo alone does not fix it


def scores_of(fit: Fit, noise: float, information: Array) -> tuple[Array, float]:
    """Covariance of what the photos pull at the free shared numbers, from how they do.

    Parameters
    ----------
    fit : Fit
        Solved: the pulls of all photos are in balance.
    noise : float
        Pixels that a corner coordinate was taken to be good to.
    information : (G, G) array
        Of all photos and of the drawing, on the free shared numbers, positive definite.

    Returns
    -------
    scores : (G, G) array
        The information of the photos alone, where corners err independently and as much as was taken.
    factor : float
        By how much the variances exceed that on average.
    """
    size = 1.0 / np.sqrt(np.diag(information))
    values, vectors = np.linalg.eigh(size[:, None] * information * size)
    values = np.maximum(values, 1e-12 * values.max())
    whiten = (size[:, None] * vectors) / np.sqrt(values)
    unwhiten = (vectors * np.sqrt(values)) / size[:, None]
    own, pulls = np.zeros_like(information), []
    seen = foreseen = 0.0
    for photo in fit.photos:
        known, pull = _of_photo(fit, photo, noise)
        known, pull = whiten.T @ known @ whiten, whiten.T @ pull
        own += known
        # What a photo pulls has gone into the solution in part.
        left, ways = np.linalg.eigh(np.eye(len(known)) - known)
        pulls.append(ways @ ((ways.T @ pull) / np.sqrt(np.maximum(left, _LEAST))))
        seen += float(pull @ pull)
        foreseen += float(np.trace(known) - np.sum(known**2))
    one = float(np.trace(own)) / len(pulls)  # one photo more, of corners that err independently
    factor = (seen + one) / (foreseen + one)
    shared = _positive(_shrunk(np.array(pulls), factor * own) - own)  # what is shared only takes away
    return unwhiten @ (own + shared) @ unwhiten.T, max(factor, 1.0)


def _of_photo(fit: Fit, photo: int, noise: float) -> tuple[Array, Array]:
    """Information (G, G) of a photo, its poses taken out, and its pull (G,)."""
    part = fit.of_photos([photo])
    looks = part.looks.only(part.kept)
    normal = normal_equations(part.state, looks, np.ones(len(looks.pixels)))
    known, pull, _, _ = restricted(normal, fit.free).reduced()
    return known / noise**2, pull / noise**2


def _shrunk(pulls: Array, target: Array) -> Array:
    """Sum of the outer products of vectors (K, G), drawn to a target as far as it is uncertain."""
    count = len(pulls)
    each = np.einsum("ki,kj->kij", pulls, pulls)
    whole = each.sum(axis=0)
    uncertain = float(np.sum((each - whole / count) ** 2)) * count / max(count - 1, 1)
    apart = float(np.sum((whole - target) ** 2))
    share = min(uncertain / apart, 1.0) if count > 1 and apart > 0 else 1.0
    return np.asarray((1.0 - share) * whole + share * target)


def _positive(matrix: Array) -> Array:
    """A symmetric matrix without what is negative of it."""
    values, vectors = np.linalg.eigh(matrix)
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)
