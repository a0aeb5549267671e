"""What the photos say of the rig's numbers: information, covariance, and the directions left open."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from facetcam.calibration import lens
from facetcam.calibration.fit import Fit
from facetcam.calibration.least_squares import normal_equations, restricted
from facetcam.calibration.likeness import scores_of
from facetcam.calibration.optics import MirrorOptics
from facetcam.calibration.result import Parameters
from facetcam.rig import Rig
from facetcam.rig.covariance import GLASS, Axes, RigCovariance

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_LOOSE = 10.0  # sigmas by which a number may differ from what was measured of it
OPEN = 0.3  # of the drawing's tolerance: where photos leave more than this, they are said to know nothing


@dataclass(frozen=True, eq=False)
class Knowledge:
    """Information of the photos on the free numbers of lens and mirrors, all else taken out.

    Attributes
    ----------
    names : tuple of str
        Of all numbers, free or held.
    free : (F,) int array
        Indices of the free ones.
    tolerance : (F,) array
        Of the drawing.
    information : (F, F) array
        Of the photos alone, per tolerance squared: 1 is a photo set as good as the drawing.
    scores : (F, F) array
        Covariance of what the photos pull, same units: the information, if all corners err independently.
    noise : float
        Pixels that a corner coordinate was taken to be good to.
    factor : float
        By how much the variances exceed those of independent corners on average.
    """

    names: tuple[str, ...]
    free: Index
    tolerance: Array
    information: Array
    scores: Array
    noise: float
    factor: float = 1.0

    @cached_property
    def _eigen(self) -> tuple[Array, Array]:
        values, vectors = np.linalg.eigh(self.information)
        return np.maximum(values, 0.0), vectors

    @cached_property
    def open_directions(self) -> Array:
        """Orthonormal directions (F, D), in units of the tolerance, that the photos leave open."""
        values, vectors = self._eigen
        return vectors[:, values < OPEN**-2]

    @cached_property
    def open_steps(self) -> Array:
        """Steps (F, D) of one standard deviation along the open directions, SI units."""
        values, _ = self._eigen
        spread = 1.0 / np.sqrt(values[values < OPEN**-2] + 1.0)
        return self.tolerance[:, None] * self.open_directions * spread

    @cached_property
    def covariance(self) -> Array:
        """Of the free numbers (F, F), SI units; open directions have the drawing's tolerance."""
        values, vectors = self._eigen
        inverse = (vectors / (values + 1.0)) @ vectors.T
        scaled = inverse @ (self.scores + np.eye(len(inverse))) @ inverse
        return self.tolerance[:, None] * (0.5 * (scaled + scaled.T)) * self.tolerance

    @property
    def sigma(self) -> Array:
        """Standard deviations (F,); NaN where the photos leave a number open."""
        sigma = np.sqrt(np.diag(self.covariance))
        return np.where(sigma < OPEN * self.tolerance, sigma, np.nan)


def knowledge(fit: Fit, noise: float, settled: bool = True) -> Knowledge:
    """What the corners kept say, each coordinate good to `noise` pixels.

    Parameters
    ----------
    settled : bool
        Whether the fit is solved, so that its residuals tell what the corners of a photo have in common.
    """
    whole = _information(fit, noise)
    pulled, factor = scores_of(fit, noise, whole + _drawn(fit)) if settled else (whole, 1.0)
    rig = int(np.count_nonzero(fit.free[: fit.state.first_board]))
    B, C = whole[:rig, rig:], whole[rig:, rig:]
    # A board hardly seen has next to no information; it must not divide by zero.
    C = C + 1e-9 * np.diag(np.diag(C)) + 1e-6 * np.eye(len(C))
    boards_out = np.hstack([np.eye(rig), -np.linalg.solve(C, B.T).T])
    free = np.flatnonzero(fit.free[: fit.state.first_board])
    tolerance = np.concatenate([fit.prior.tolerance, fit.state.optics.tolerance])[free]
    # What is stated of glass is a measurement, not a tolerance: it is known that well without any photo.
    measured = free >= len(fit.state.intrinsics) + 3 * len(_mirrors(fit).planes)
    tolerance[measured] *= _LOOSE
    stated = np.diag(_LOOSE**2 * measured)
    information, scores = (
        tolerance[:, None] * (0.5 * (A + A.T)) * tolerance + stated
        for A in (boards_out @ whole[:, :rig], boards_out @ pulled @ boards_out.T)
    )
    return Knowledge(names_of(fit), free, tolerance, information, scores, noise, factor)


def shared_covariance(fit: Fit, noise: float) -> Array:
    """Covariance of all shared parameters, boards too, by photos and drawing; held ones zero."""
    known = information(fit, noise)
    scale = 1.0 / np.sqrt(np.diag(known))
    inverse = np.outer(scale, scale) * np.linalg.inv(scale[:, None] * known * scale)
    scores, _ = scores_of(fit, noise, known)
    covariance = np.zeros((fit.state.shared, fit.state.shared))
    covariance[np.ix_(fit.free, fit.free)] = inverse @ (scores + _drawn(fit)) @ inverse
    return covariance


def information(fit: Fit, noise: float) -> Array:
    """What photos and drawing say of the free shared parameters, boards too."""
    return _information(fit, noise) + _drawn(fit)


def _drawn(fit: Fit) -> Array:
    """What the drawing says of the free shared parameters."""
    slope = replace(fit.prior, noise=1.0).rows(fit.state)[1][fit.free]
    # A board that no photo ties to the others is open; it must not divide by zero.
    return np.diag(slope**2 + 1e-6)


def _information(fit: Fit, noise: float) -> Array:
    """What the corners kept say of the free shared parameters, the rig poses taken out."""
    looks = fit.looks.only(fit.kept)
    normal = normal_equations(fit.state, looks, np.ones(len(looks.pixels)))
    return restricted(normal, fit.free).reduced()[0] / noise**2


def names_of(fit: Fit) -> tuple[str, ...]:
    """Names of all numbers of lens and mirrors."""
    return lens.NAMES[fit.state.model] + _mirrors(fit).parameters


def parameters_of(fit: Fit, known: Knowledge) -> Parameters:
    """The free numbers with their sigmas, tilts in degrees, lengths in millimetres."""
    optics = _mirrors(fit)
    lenses = len(fit.state.intrinsics)
    values = np.concatenate([fit.state.intrinsics, optics.values])
    units = ["px"] * 4 + [""] * (lenses - 4) + ["deg", "deg", "mm"] * len(optics.planes)
    units += ["mm", ""] * len(optics.sheets)
    scale = {"px": 1.0, "": 1.0, "deg": float(np.degrees(1.0)), "mm": 1e3}
    factors = np.array([scale[units[i]] for i in known.free])
    return Parameters(
        tuple(known.names[i] for i in known.free),
        tuple(units[i] for i in known.free),
        values[known.free] * factors,
        known.sigma * factors,
        known.covariance,
    )


def rig_covariance(fit: Fit, known: Knowledge) -> RigCovariance:
    """What a rig file keeps of it: the tilts now about the mirrors as built."""
    axes = {}
    for name, plane in zip(_mirrors(fit).names, _mirrors(fit).planes):
        turned = plane.axes @ plane.motion()[:3, :3].T
        pivot = plane.pivot + plane.values[2] * plane.plane[0]
        u, v, p = ((float(x), float(y), float(z)) for x, y, z in (*turned, pivot))
        axes[name] = Axes(u, v, p)
    alone = [(row, name) for row, index in enumerate(known.free) for name in _of_each(known.names[index])]
    rows, names = [row for row, _ in alone], tuple(name for _, name in alone)
    used = {name.partition(": ")[0] for name in names}
    matrix = known.covariance[np.ix_(rows, rows)]
    return RigCovariance(names, matrix, {m: a for m, a in axes.items() if m in used})


def _of_each(name: str) -> list[str]:
    """The number of a sheet as that of each of its mirrors."""
    mirrors, colon, word = name.partition(": ")
    return [mirror + colon + word for mirror in mirrors.split(", ")]


def with_sigmas(rig: Rig, parameters: Parameters) -> Rig:
    """The rig with the solved sigmas of its glass in the place of those stated before."""
    sigmas = np.sqrt(np.diag(parameters.covariance)).tolist()
    sigma = {alone: s for name, s in zip(parameters.names, sigmas) for alone in _of_each(name)}
    mirrors = dict(rig.mirrors)
    for name, mirror in rig.mirrors.items():
        if mirror.glass is not None:
            found = {f"{word}_sigma": sigma.get(f"{name}: {word}") for word in GLASS}
            known = {key: value for key, value in found.items() if value is not None}
            mirrors[name] = replace(mirror, glass=replace(mirror.glass, **known))
    return replace(rig, mirrors=mirrors)


def _mirrors(fit: Fit) -> MirrorOptics:
    assert isinstance(fit.state.optics, MirrorOptics)
    return fit.state.optics
