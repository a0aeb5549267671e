"""Photos of another lens or place of it: refocused, zoomed a little, or moved against the mirrors."""

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

_TOLERANCE = 10.0  # pixels by which the corner of an image may lie elsewhere
_FREE = (1, 3)  # numbers of each photo: a scale; and a shift
_WRONG = 1.5  # squared error, against that of noise, from which a cause is looked for
_MOST = 0.75  # quantile of the photos of which this is asked
_MENDED = 0.25  # of what is beyond noise that may remain: scales do not mend what bends paper or lens
_ROUNDS = {1: 8, 3: 16}
_EXPLAINED = 4.0  # squared error that may remain in a photo: where more does, it is not the focal length
_SURELY = 3  # boards, or views of one, that make a photo a witness
_REST = 2  # witnesses enough to tell that photos are still not of one focus
_LEAST = 0.1  # pixels by which a corner of the image must move for it
_SURE = 4.0  # sigmas that the focal length of a photo must be off
_STILL = 0.01  # pixels of a step at which they have settled


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
    others, words = found.finding.photos, found.finding.words
    rest = fit.of_photos([p for p in fit.photos if p not in others]).solved(TIGHT)
    few, noise = 2 * len(others) < _showing(fit, 2).sum(), corner_noise(rest)
    sound = float(np.quantile(_ratios(rest, noise), _MOST)) < _WRONG
    if few and sound and other_focus(rest, noise, _REST) is None:
        return rest, (Finding("other focus", f"{words}; they are left out", others),), True
    return fit, (Finding("focus", f"{words}; take all anew with one lens held still", others),), False


def other_focus(fit: Fit, noise: float, fewest: int = 6) -> Explanation | None:
    """Give every photo a focal length of its own, or a principal point too, if that explains what is wrong.

    Scaled about the principal point and shifted, an image is as if taken with the usual lens. Scales and
    shifts of all photos and the joint solve take turns.

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
    if _showing(fit, _SURELY).sum() < fewest:
        return None
    for free in _FREE:
        found = _each_its_own(fit, noise, free)
        if found is not None:
            return found
    return None


def _each_its_own(fit: Fit, noise: float, free: int) -> Explanation | None:
    """Free the scale of each photo, and with three numbers its shift."""
    number = np.searchsorted(fit.photos, [s.photo for s in fit.sightings])[fit.looks.sighting]
    tied = _showing(fit, 2)
    lens, sigma = np.zeros((2, len(fit.photos), free))
    numbers = free * (int(tied.sum()) - 1)
    found = Explanation(fit, Finding("focus", ""), sum(misfit(fit, noise).values()), numbers)
    limit = found.misfit - CLEAR
    for done in range(_ROUNDS[free]):
        step, sigma = _steps(found.fit, number, lens, noise)
        step, sigma = np.where(tied[:, None], step, 0.0), np.where(tied[:, None], sigma, np.inf)
        lens = lens + step
        lens[tied] -= np.average(lens[tied], axis=0, weights=sigma[tied] ** -2)
        trial = _as_usual(found.fit, fit.looks.pixels, lens[number]).solved(snap(noise), 20)
        found = replace(found, fit=trial, misfit=sum(misfit(trial, noise).values()))
        if found.price > limit and done >= free - 1:
            return None
        if float(np.abs(step).max()) < _STILL:
            break
    finding = _told(fit, found.fit, lens, sigma, noise)
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


def _told(fit: Fit, scaled: Fit, lens: Array, sigma: Array, noise: float) -> Finding | None:
    """Name the photos furthest from the usual lens, if that explains them and is worth a word."""
    before, after = _ratios(fit, noise), _ratios(scaled, noise)
    old, new = np.quantile([before, after], _MOST, axis=1).tolist()
    if old < _WRONG or new > _EXPLAINED or new - 1.0 > _MENDED * (old - 1.0):
        return None
    told = np.asarray(np.isfinite(sigma).all(axis=1))
    off = np.where(told[:, None], lens - _usual(lens[told], sigma[told]), 0.0)
    length = np.linalg.norm(off, axis=1)
    apart = np.linalg.norm(off / sigma, axis=1) / max(1.0, float(np.sqrt(new)))
    sure = np.asarray((length > _LEAST) & (apart > _SURE))
    far = np.asarray(sure & (length > 0.5 * length[sure].max(initial=0.0)))
    if not (far & _showing(fit, _SURELY)).any() or after[far].max() > _EXPLAINED:
        return None
    worst = off[far][np.argmax(length[far])]
    if 2 * np.count_nonzero(far) > np.count_nonzero(told):  # the fewer are named
        far, worst = told & ~far, -worst
    photos = tuple(p for p, f in zip(fit.photos, far) if f)
    return Finding("focus", _words(worst, _reach(fit)), photos)


def _words(off: Array, reach: float) -> str:
    scale, shift = 100 * float(off[0]) / reach, float(np.linalg.norm(off[1:]))
    if shift > abs(off[0]):
        return (
            f"the image is shifted between photos, in {{photos}} by up to {shift:.1f} px:"
            " another camera, or it moved against its mirrors"
        )
    return (
        f"the focal length differs between photos, in {{photos}} by up to {scale:+.2f} %:"
        " the lens was refocused or zoomed"
    )


def _usual(lens: Array, sigma: Array) -> Array:
    """The scale and shift that most photos agree with."""
    apart = np.linalg.norm((lens[:, None] - lens) / sigma, axis=2)
    return np.asarray(lens[np.argmin(np.minimum(apart, _SURE).sum(axis=1))])


def _reach(fit: Fit) -> float:
    """Pixels from the middle of the image to its corner."""
    return 0.5 * float(np.hypot(*fit.nominal.size))


def _ratios(fit: Fit, noise: float) -> Array:
    """Squared error of each photo against that of noise alone."""
    lengths = np.linalg.norm(fit.residuals, axis=1) / (RAYLEIGH * noise)
    photo = np.array([s.photo for s in fit.sightings], dtype=np.int64)[fit.looks.sighting]
    return np.array([np.median(lengths[photo == p]) ** 2 for p in fit.photos])


def _as_usual(fit: Fit, pixels: Array, lens: Array) -> Fit:
    """The fit without what each corner (N, 1 or 3) has of scale, pixels at the image's corner, and shift."""
    middle, shift = fit.state.intrinsics[2:4], lens[:, 1:] if lens.shape[1] > 1 else 0.0
    scale = np.exp(lens[:, :1] / _reach(fit))
    return replace(fit, looks=replace(fit.looks, pixels=middle + (pixels - shift - middle) / scale))


def _steps(fit: Fit, number: Index, lens: Array, noise: float) -> tuple[Array, Array]:
    """What scale and shift of each photo are off by, its poses free, and one sigma; both (photos, 1 or 3)."""
    looks, free = fit.looks, lens.shape[1]
    linear = linearise(fit.state, looks)
    residual = looks.pixels - linear.predicted
    weight = 1.0 / np.sqrt(1.0 + np.sum(residual**2, axis=1) / snap(noise) ** 2)
    by_lens = np.zeros((len(residual), 2, 3))
    by_lens[:, :, 0] = (linear.predicted - fit.state.intrinsics[2:4]) / _reach(fit)
    by_lens[:, :, 1:] = np.eye(2)
    by_lens = by_lens[:, :, :free] * weight[:, None, None]
    residual, by_pose = residual * weight[:, None], linear.station * weight[:, None, None]
    information = np.tile((noise / _TOLERANCE) ** 2 * np.eye(free), (len(lens), 1, 1))
    right = -((noise / _TOLERANCE) ** 2) * lens
    station = looks.station[looks.sighting]
    for p in np.unique(station):
        rows = np.flatnonzero(station == p)
        Q = np.linalg.qr(by_pose[rows].reshape(-1, 6))[0]
        told = by_lens[rows].reshape(-1, free)
        told = told - Q @ (Q.T @ told)
        information[number[rows[0]]] += told.T @ told
        right[number[rows[0]]] += told.T @ residual[rows].ravel()
    inverse = np.linalg.inv(information)
    sigma = noise * np.sqrt(np.einsum("pii->pi", inverse))
    return np.einsum("pij,pj->pi", inverse, right), sigma
