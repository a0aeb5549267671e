"""Photos whose views do not fit together: camera, board or mirrors crept while they were taken."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.stats import chi2
from scipy.stats import f as fisher

from facetcam.calibration.fit import Fit
from facetcam.calibration.problem import linearise
from facetcam.calibration.result import Finding

Array = NDArray[np.float64]

CHANCE = 0.05  # that of all photos, none of which crept, one is named
_CORNERS = 4  # of a view, from which its shift counts
_FEWEST = 5  # photos that must be there to tell what is usual
_TOLD = 0.1  # of a shift: where the pose takes up more of it than the rest, it says nothing


@dataclass(frozen=True, slots=True)
class Creep:
    """How far the views of one photo stand apart.

    Attributes
    ----------
    photo : int
    view : str
        That stands furthest, for its sigma, from where the photo's other views have it.
    shift, sigma : float
        Of its corners, pixels; sigma holds the noise and what the usual photo shows.
    chance : float
        That as much, in any photo of the set, comes about though nothing crept.
    """

    photo: int
    view: str
    shift: float
    sigma: float
    chance: float


@dataclass(frozen=True, eq=False)
class _Shifts:
    """What the corners of one station say of shifts of its views, the pose taken out."""

    station: int
    views: list[int]
    information: Array  # (2V, 2V), for a noise of 1
    right: Array  # (2V,)
    weight: float  # of the corners of a view on the average: information if the pose were known
    rest: float  # sum of squares that shifts do not explain
    freedom: int  # of the rest

    @cached_property
    def apart(self) -> tuple[Array, Array]:
        """Independent directions that are told: squares of their gains, and components of noise 1."""
        gains, parts = _components(self.information, self.right)
        told = gains > _TOLD * self.weight
        return gains[told], parts[told]

    def misfit(self, noise: float, usual: float) -> float:
        """Chi-square of the shifts where a corner has this noise and a view the shift `usual`, pixels."""
        gains, parts = self.apart
        return float(np.sum(parts**2 / (noise**2 + usual**2 * gains)))

    def worst(self, noise: float, usual: float) -> tuple[int, float, float]:
        """The view furthest, for its sigma, from where the others have it; its shift and sigma."""
        found = []
        whole = self.information @ self.information
        for k, view in enumerate(self.views):
            own = slice(2 * k, 2 * k + 2)
            inverse = np.linalg.inv(self.information[own, own])
            length = float(np.linalg.norm(inverse @ self.right[own]))
            spread = noise**2 * inverse + usual**2 * inverse @ whole[own, own] @ inverse
            told = np.linalg.eigvalsh(self.information[own, own])[0] > _TOLD * self.weight
            found.append((bool(told), view, length, float(np.sqrt(np.trace(spread) / 2))))
        return max(found, key=lambda v: (v[0], v[2] / v[3]))[1:]


def creeps(fit: Fit) -> tuple[Creep, ...]:
    """Test every photo that shows boards in several views, the likeliest to have crept first.

    A shift of each view is tried beside the pose of the board. What the model misses (paper that is not flat,
    a bent pane) shifts views in all photos; how much is usual is a random effect, taken from the middle of
    the set as Paule and Mandel (1982) do from its mean, so that up to half of the photos may have crept.
    Empty where fewer than five photos show several views.
    """
    tests = [t for t in _tests(fit) if len(t.apart[0])]
    if len(tests) < _FEWEST:
        return ()
    noise = float(np.sqrt(sum(t.rest for t in tests) / max(sum(t.freedom for t in tests), 1)))
    usual = _usual(tests, noise)
    # The middle of a set wastes more than half of what it says of the usual.
    known = sum(len(t.apart[0]) for t in tests) / 3
    found = []
    for t in tests:
        told = len(t.apart[0])
        chance = len(tests) * float(fisher.sf(t.misfit(noise, usual) / told, told, known))
        view, shift, sigma = t.worst(noise, usual)
        photo = fit.stations[t.station][0]
        found.append(Creep(photo, fit.views[view], shift, sigma, min(1.0, chance)))
    return tuple(sorted(found, key=lambda c: c.chance))


def crept(fit: Fit) -> tuple[Finding, ...]:
    """Name the photos that crept."""
    return tuple(
        Finding(
            "crept",
            f"photo {{photos}} crept: view '{c.view}' lies {c.shift:.2f} +- {c.sigma:.2f} px beside where its"
            f" other views have it (chance {c.chance:.1g}); take it anew with everything standing still",
            (c.photo,),
        )
        for c in creeps(fit)
        if c.chance < CHANCE
    )


def _usual(tests: Sequence[_Shifts], noise: float) -> float:
    """Shift of a view in pixels with which the middle one of the tests is as likely as not."""

    def excess(usual: float) -> float:
        return float(np.median([chi2.cdf(t.misfit(noise, usual), len(t.apart[0])) for t in tests])) - 0.5

    most = 100.0
    return float(brentq(excess, 0.0, most, xtol=1e-4)) if excess(0.0) > 0 > excess(most) else 0.0


def _tests(fit: Fit) -> Iterator[_Shifts]:
    looks = fit.looks.only(fit.kept)
    linear = linearise(fit.state, looks)
    weight = 1.0 / looks.noise
    residual = (looks.pixels - linear.predicted) * weight[:, None]
    by_pose = linear.station * weight[:, None, None]
    station, view = looks.station[looks.sighting], looks.view[looks.sighting]
    for p in np.unique(station):
        rows = np.flatnonzero(station == p)
        views, counts = np.unique(view[rows], return_counts=True)
        views = views[counts >= _CORNERS]
        rows = rows[np.isin(view[rows], views)]
        if len(views) > 1:
            member = (view[rows][:, None] == views) * weight[rows, None]
            yield _test(int(p), views.tolist(), member, by_pose[rows], residual[rows])


def _test(station: int, views: list[int], member: Array, by_pose: Array, residual: Array) -> _Shifts:
    """Test of one station; `member` (N, V) holds the weight of a corner in the column of its view."""
    pose = np.linalg.qr(by_pose.reshape(-1, 6))[0]
    both = np.column_stack([np.kron(member, np.eye(2)), residual.ravel()])  # (2N, 2V + 1)
    both -= pose @ (pose.T @ both)
    information, right = both[:, :-1].T @ both[:, :-1], both[:, :-1].T @ both[:, -1]
    weight = float(np.sum(member**2)) / len(views)
    parts = _components(information, right)[1]
    rest = max(float(both[:, -1] @ both[:, -1] - parts @ parts), 0.0)
    return _Shifts(station, views, information, right, weight, rest, len(both) - 6 - len(parts))


def _components(information: Array, right: Array) -> tuple[Array, Array]:
    gains, directions = np.linalg.eigh(information)
    sound = gains > 1e-9 * gains[-1]
    return gains[sound], (directions.T @ right)[sound] / np.sqrt(gains[sound])
