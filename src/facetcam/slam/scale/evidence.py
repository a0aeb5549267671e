"""What sightings in other views say of a map's scale, with points as their own view alone has mapped them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from facetcam.slam.adjustment.bundle import Bundle
from facetcam.slam.adjustment.information import linearise_points
from facetcam.slam.camera.optics import Optics

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Rows = NDArray[np.bool_]

LARGEST = 0.7  # logarithm of the largest stretch that is told
_VAGUE = 0.15  # error of one sighting's stretch, beyond which it says nothing
_BY_CHANCE = 0.3  # share of the sightings that may be of something else
_UNLIKE_CHANCE = 5.0  # logarithm of how much likelier the sightings must be than such by chance
_LEAST_POINTS = 8
_GRID = np.linspace(-LARGEST, LARGEST, 1401)
_ALIKE = 0.005  # stretches that are taken for one
_WITHIN = 3.0  # sigmas
_BY_NOISE = 1.5  # sigmas by which map and test may differ before it counts as an error of the scale
_LARGER = 1.65  # times as unsure as they scatter: they err by more (benchmarks/slam_starts.py)
_SHARED = 3.0  # standard deviations of the noise that errors which many sightings share may be large
_STEPS = 4
_TINY = 1e-6  # of a point's largest information, which holds what its view cannot tell


@dataclass(frozen=True, slots=True)
class Evidence:
    """Stretch that would make a map fit sightings in other views.

    Attributes
    ----------
    stretch, sigma : float
        Natural logarithm of its factor, and its standard deviation; inf where too few agree.
    points : int
        That bear it out.
    agrees : (M,) bool array
        Sightings that do.
    ahead : float
        Logarithm of how much likelier it makes them than the scale of the map as it is.
    """

    stretch: float
    sigma: float
    points: int
    agrees: Rows
    ahead: float = 0.0

    @classmethod
    def none(cls, count: int = 0) -> Evidence:
        """Of sightings that say nothing."""
        return cls(0.0, np.inf, 0, np.zeros(count, dtype=bool))

    def tested(self, scale_sigma: float, earlier: float = np.inf) -> float:
        """Standard deviation of a scale after this test: inf where it denies the scale, or cannot tell.

        What a map knows of its own scale counts noise alone. Errors that its sightings share may be some
        times as large, so far as the test, or an earlier one, has not found the scale to be right; what the
        two differ by beyond noise is one.
        """
        told = min(_LARGER * self.sigma, earlier)
        expected = np.hypot(scale_sigma, told)
        if not (np.isfinite(told) and abs(self.stretch) < _WITHIN * expected):
            return np.inf
        shared = 1.0 / np.hypot(1.0 / told, 1.0 / (_SHARED * scale_sigma))
        unexplained = max(self.stretch**2 - (_BY_NOISE * expected) ** 2, 0.0)
        return float(np.sqrt(scale_sigma**2 + shared**2 + unexplained))


def scale_evidence(
    whole: Bundle, sightings: Bundle, home: NDArray[np.integer], optics: Optics, pixel_sigma: float
) -> Evidence:
    """Compare sightings with the points as another view alone has mapped them.

    At another scale a point lies elsewhere on the ray of that view. How far along the image of this ray it is
    found tells the scale; how far beside it, whether it is the same point at all. Every point has one vote.

    Parameters
    ----------
    whole : Bundle
        A map.
    sightings : Bundle
        Of the same frames and points.
    home : (M,) int array
        View from which each sighting has been sought in another.
    optics : Optics
    pixel_sigma : float
        Standard deviation of a sighting.
    """
    n_views = optics.n_views
    tracks, track = np.unique(sightings.point * n_views + home, return_inverse=True)
    xyz, covariance = _mapped_alone(whole, tracks, optics, pixel_sigma)
    T = whole.T_world_rig[sightings.frame]
    centre = np.einsum("nij,nj->ni", T[:, :3, :3], optics.origins(home)) + T[:, :3, 3]
    reach, stretch = xyz[track] - centre, np.zeros(len(track))
    for _ in range(2 * _STEPS):
        far = np.exp(stretch)[:, None] * reach
        residual, by_point = linearise_points(sightings, centre + far, optics)
        along = np.einsum("nij,nj->ni", by_point, far)
        slope = np.maximum(np.linalg.norm(along, axis=1), 1e-9)
        stretch = np.clip(stretch - np.sum(along * residual, axis=1) / slope**2, -2 * LARGEST, 2 * LARGEST)
    along /= slope[:, None]
    beside = np.column_stack([-along[:, 1], along[:, 0]])
    spread = by_point @ covariance[track] @ np.swapaxes(by_point, 1, 2) + pixel_sigma**2 * np.eye(2)
    sigma, sigma_beside = (np.sqrt(np.einsum("ni,nij,nj->n", a, spread, a)) for a in (along, beside))
    good = np.abs(np.sum(beside * residual, axis=1)) < _WITHIN * sigma_beside
    good &= (sigma < _VAGUE * slope) & (np.abs(stretch) < LARGEST)
    return _consensus(stretch, sigma / slope, sightings.point, good)


def home_views(view: NDArray[np.integer], point: Index, count: int) -> NDArray[np.int8]:
    """View (count,) that sees each point most often, -1 where none does."""
    n_views = int(view.max(initial=0)) + 1
    seen = np.bincount(point * n_views + view, minlength=count * n_views).reshape(count, n_views)
    return np.where(seen.any(axis=1), seen.argmax(axis=1), -1).astype(np.int8)


def _mapped_alone(whole: Bundle, tracks: Index, optics: Optics, pixel_sigma: float) -> tuple[Array, Array]:
    """Points (N, 3) as single views place them from poses that are held, and their covariances.

    A track is what one view saw of a point, named by n_views * point + view; the names are sorted.
    """
    name = whole.point * optics.n_views + whole.view
    rows = np.isin(name, tracks)
    some = replace(
        whole, frame=whole.frame[rows], view=whole.view[rows], plane=whole.plane[rows], edge=whole.edges[rows]
    )
    some.point = np.searchsorted(tracks, name[rows])
    xyz = whole.points[tracks // optics.n_views]
    for _ in range(_STEPS):
        residual, by_point = linearise_points(some, xyz[some.point], optics)
        weight = 1.0 / (1.0 + np.sum(residual**2, axis=1) / pixel_sigma**2)
        H, gradient = np.zeros((len(xyz), 3, 3)), np.zeros((len(xyz), 3))
        np.add.at(H, some.point, np.einsum("n,nij,nik->njk", weight, by_point, by_point))
        np.add.at(gradient, some.point, np.einsum("n,nij,ni->nj", weight, by_point, residual))
        H += (_TINY * np.trace(H, axis1=1, axis2=2) + 1e-9)[:, None, None] * np.eye(3)
        xyz -= np.linalg.solve(H, gradient[:, :, None])[:, :, 0]
    return xyz, np.asarray(pixel_sigma**2 * np.linalg.inv(H))


def _consensus(stretch: Array, sigma: Array, point: Index, good: Rows) -> Evidence:
    """The stretch that is likeliest where a share of the sightings is anywhere."""
    nothing = Evidence.none(len(stretch))
    if not good.any():
        return nothing
    s, e, vote = stretch[good], sigma[good], 1.0 / np.bincount(point[good])[point[good]]
    normal = np.exp(-0.5 * ((_GRID[:, None] - s) / e) ** 2) / (np.sqrt(2.0 * np.pi) * e)
    support = np.log(_BY_CHANCE + (1.0 - _BY_CHANCE) * 2.0 * LARGEST * normal) @ vote
    best = _GRID[np.argmax(support)]
    agrees = np.zeros(len(stretch), dtype=bool)
    agrees[good] = np.abs(s - best) < _WITHIN * e
    points = len(np.unique(point[agrees]))
    ahead = float(support.max() - support[np.abs(_GRID) < _ALIKE].max())
    if support.max() < _UNLIKE_CHANCE or points < _LEAST_POINTS:
        return nothing
    chosen = agrees[good]
    s, weight = s[chosen], vote[chosen] / e[chosen] ** 2
    mean = float(np.sum(weight * s) / weight.sum())
    excess = float(np.sum(weight * (s - mean) ** 2) / vote[chosen].sum())
    return Evidence(mean, float(np.sqrt(max(excess, 1.0) / weight.sum())), points, agrees, ahead)
