"""Whether mirrors are flat: a plane has three parameters, the pose of a view six."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from facetcam.calibration.covariance import information, knowledge
from facetcam.calibration.fit import Fit
from facetcam.calibration.free_optics import FreeOptics
from facetcam.calibration.likeness import scores_of
from facetcam.calibration.optics import MirrorOptics
from facetcam.calibration.quality import Flatness

_CHANCE = 1e-4  # that flat mirrors look bent
_FEWEST = 3  # views; of two, which one is bent cannot be told


def flatness(fit: Fit, noise: float) -> Flatness | None:
    """Compare planes with free poses of the views; None where the two have as many parameters."""
    optics = fit.state.optics
    assert isinstance(optics, MirrorOptics)
    known = knowledge(fit, noise)
    lenses = len(fit.state.intrinsics)
    planes = np.count_nonzero(known.free >= lenses) - known.open_directions.shape[1]
    more = 6 * (len(fit.views) - 1) - int(planes)
    if more <= 0:
        return None
    freed = _freed(fit)
    drop, plane, free = _drop(fit, freed, noise), _rms(fit), _rms(freed)
    # Corners of a photo err alike, and so do the views.
    alike = scores_of(freed, noise, information(freed, noise))[1]
    flat = bool(drop < alike * chi2.ppf(1.0 - _CHANCE, more))
    return Flatness(plane, free, drop / more, flat, "" if flat else _bent(fit, noise))


def _bent(fit: Fit, noise: float) -> str:
    """The view without which planes explain the others best."""
    view = fit.looks.view[fit.looks.sighting]
    left = {}
    for index, name in enumerate(fit.views):
        rest = replace(fit, kept=fit.kept & (view != index)).solved(None, 30)
        left[name] = _drop(rest, _freed(rest), noise)
    return min(left, key=lambda name: left[name]) if len(left) >= _FEWEST else ""


def _drop(fit: Fit, freed: Fit, noise: float) -> float:
    """By how much free views lower the sum of squares, in units of the noise."""
    worth = 1.0 / (noise * fit.looks.noise[:, None]) ** 2
    return float(np.sum(((fit.residuals**2 - freed.residuals**2) * worth)[fit.kept]))


def _freed(fit: Fit) -> Fit:
    """The same problem solved with six parameters a view, the first view held as the frame of the rig."""
    lenses, mirrors = len(fit.state.intrinsics), fit.state.optics
    assert isinstance(mirrors, MirrorOptics)
    optics = FreeOptics.of_mirrors(mirrors)
    views = np.arange(optics.count) >= 6
    free = np.concatenate([fit.free[:lenses], views, fit.free[fit.state.first_board :]])
    return replace(fit, state=replace(fit.state, optics=optics), free=free).solved(None, 30)


def _rms(fit: Fit) -> float:
    return float(np.sqrt(np.mean(np.sum(fit.residuals[fit.kept] ** 2, axis=1))))
