"""Photos of other focal lengths: a lens that was refocused or zoomed a little, or that breathes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from facetcam.calibration.evidence import (
    CLEAR,
    TIGHT,
    Explanation,
    corner_noise,
    misfit,
    snap,
)
from facetcam.calibration.fit import Fit
from facetcam.calibration.problem import linearise
from facetcam.calibration.rejection import RAYLEIGH
from facetcam.calibration.result import Finding
from facetcam.calibration.small_moves import overdispersion

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_TOLERANCE = 0.01  # share by which focal lengths of one lens may differ
_WRONG = 1.5  # squared error, against that of noise, from which a cause is looked for
_MOST = 0.75  # quantile of the photos of which this is asked
_MENDED = 0.25  # of what is beyond noise that may remain: scales do not mend what bends paper or lens
_ROUNDS = 8
_EXPLAINED = 4.0  # squared error that may remain in a photo: where more does, it is not the focal length
_SURELY = 3  # boards, or views of one, that make a photo a witness
_REST = 2  # witnesses enough to tell that photos are still not of one focus
_LEAST = 0.1  # pixels by which a corner of the image must move for it
_SURE = 4.0  # sigmas that the focal length of a photo must be off
_STILL = 1e-5  # step of a scale at which they have settled


def in_one_focus(fit: Fit) -> tuple[Fit, tuple[Finding, ...], bool]:
    """Leave out the photos of another focus, if all the others are of one.

    Returns
    -------
    fit : Fit
    findings : tuple of Finding
        One at most.
    one : bool
        Whether the photos of the fit are of one focus.
    """
    found = other_focus(fit, corner_noise(fit))
    if found is None:
        return fit, (), True
    others, text = found.finding.photos, found.finding.text
    rest = fit.of_photos([p for p in fit.photos if p not in others]).solved(TIGHT)
    few = 2 * len(others) < _showing(fit, 2).sum()
    if few and other_focus(rest, corner_noise(rest), _REST) is None:
        return rest, (Finding("other focus", f"{text}; they are left out", others),), True
    return fit, (Finding("focus", f"{text}; take all anew in one focus", others),), False


def other_focus(fit: Fit, noise: float, fewest: int = 6) -> Explanation | None:
    """Give every photo a focal length of its own, if that explains what is wrong with all of them.

    Scaled about the principal point, an image is as if taken with the usual focal length. The scales of all
    photos and the joint solve take turns.

    Parameters
    ----------
    fit : Fit
        Solved.
    noise : float
        Pixels that a corner coordinate is good to.
    fewest : int
        Witnesses, photos that show boards in three places or more, below which nothing is told.

    Returns
    -------
    Explanation or None
        Its fit has scaled pixels: it tells how well scales explain the photos, and is not to go on with.
    """
    number = np.searchsorted(fit.photos, [s.photo for s in fit.sightings])[fit.looks.sighting]
    tied = _showing(fit, 2)
    if _showing(fit, _SURELY).sum() < fewest:
        return None
    scale, sigma = np.ones(len(fit.photos)), np.zeros(len(fit.photos))
    found = Explanation(fit, Finding("focus", ""), sum(misfit(fit, noise).values()), int(tied.sum()) - 1)
    limit = found.misfit - CLEAR
    for _ in range(_ROUNDS):
        step, sigma = _steps(found.fit, number, scale, noise)
        step, sigma = np.where(tied, step, 0.0), np.where(tied, sigma, np.inf)
        scale *= 1.0 + step
        scale[tied] /= np.average(scale[tied], weights=sigma[tied] ** -2)
        trial = _scaled(found.fit, fit.looks.pixels, scale[number]).solved(snap(noise), 20)
        found = replace(found, fit=trial, misfit=sum(misfit(trial, noise).values()))
        if found.price > limit:
            return None
        if float(np.abs(step).max()) < _STILL:
            break
    finding = _told(fit, found.fit, scale, sigma, noise)
    if finding is None or not _beyond_chance(fit, found, noise):
        return None
    return replace(found, finding=finding)


def _beyond_chance(fit: Fit, found: Explanation, noise: float) -> bool:
    """Tell whether scales still explain photos where as much is laid to chance as they leave boards apart.

    Asked are the photos that show most: in others a scale may explain what a wrong sighting did.
    """
    wider, asked = noise * float(np.sqrt(overdispersion(found.fit, noise))), _showing(fit, _SURELY)
    gain = 0.0
    for sign, f in ((1.0, fit), (-1.0, found.fit)):
        costs = misfit(f.solved(snap(wider), 20), wider)
        gain += sign * sum(costs[p] for p, a in zip(fit.photos, asked) if a)
    return gain > CLEAR + found.price - found.misfit


def _showing(fit: Fit, least: int) -> NDArray[np.bool_]:
    """Mask of the photos that show boards in so many places: one place tells a focal length from nothing."""
    count = np.bincount(np.searchsorted(fit.photos, [s.photo for s in fit.sightings]))
    return np.asarray(count >= least)


def _told(fit: Fit, scaled: Fit, scale: Array, sigma: Array, noise: float) -> Finding | None:
    """Name the photos furthest from the usual focal length, if that explains them and is worth a word."""
    before, after = _ratios(fit, noise), _ratios(scaled, noise)
    old, new = np.quantile([before, after], _MOST, axis=1).tolist()
    if old < _WRONG or new - 1.0 > _MENDED * (old - 1.0):
        return None
    told = np.isfinite(sigma)
    off = np.where(told, scale / _usual(scale[told], sigma[told]) - 1.0, 0.0)
    least = _LEAST / (0.5 * float(np.hypot(*fit.nominal.size)))
    sure = np.abs(off) > np.maximum(least, _SURE * sigma * max(1.0, float(np.sqrt(new))))
    far = sure & (np.abs(off) > 0.5 * np.abs(off[sure]).max(initial=0.0))
    if not (far & _showing(fit, _SURELY)).any() or after[far].max() > _EXPLAINED:
        return None
    worst = 100 * off[far][np.argmax(np.abs(off[far]))]
    text = (
        f"the focal length differs between photos, in {{photos}} by up to {worst:+.2f} %:"
        " the lens was refocused or zoomed"
    )
    return Finding("focus", text, tuple(p for p, f in zip(fit.photos, far) if f))


def _usual(scale: Array, sigma: Array) -> float:
    """The scale that most photos agree with."""
    apart = np.abs(scale[:, None] - scale) / sigma
    return float(scale[np.argmin(np.minimum(apart, _SURE).sum(axis=1))])


def _ratios(fit: Fit, noise: float) -> Array:
    """Squared error of each photo against that of noise alone."""
    lengths = np.linalg.norm(fit.residuals, axis=1) / (RAYLEIGH * noise)
    photo = np.array([s.photo for s in fit.sightings], dtype=np.int64)[fit.looks.sighting]
    return np.array([np.median(lengths[photo == p]) ** 2 for p in fit.photos])


def _scaled(fit: Fit, pixels: Array, scale: Array) -> Fit:
    middle = fit.state.intrinsics[2:4]
    return replace(fit, looks=replace(fit.looks, pixels=middle + (pixels - middle) / scale[:, None]))


def _steps(fit: Fit, number: Index, scale: Array, noise: float) -> tuple[Array, Array]:
    """What the scale of each photo is off by, its poses free, and one sigma; both (photos,)."""
    looks = fit.looks
    linear = linearise(fit.state, looks)
    residual = looks.pixels - linear.predicted
    weight = 1.0 / np.sqrt(1.0 + np.sum(residual**2, axis=1) / snap(noise) ** 2)
    by_scale = (linear.predicted - fit.state.intrinsics[2:4]) * weight[:, None]
    residual, by_pose = residual * weight[:, None], linear.station * weight[:, None, None]
    information = np.full(len(scale), (noise / _TOLERANCE) ** 2)
    right = -information * np.log(scale)
    station = looks.station[looks.sighting]
    for p in np.unique(station):
        rows = np.flatnonzero(station == p)
        Q = np.linalg.qr(by_pose[rows].reshape(-1, 6))[0]
        told = by_scale[rows].ravel()
        told = told - Q @ (Q.T @ told)
        information[number[rows[0]]] += told @ told
        right[number[rows[0]]] += told @ residual[rows].ravel()
    return right / information, noise / np.sqrt(information)
