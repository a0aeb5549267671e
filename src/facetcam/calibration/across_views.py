"""A photo's pose from one view, judged in its others: how far it is off, and what the sigmas foretell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from facetcam.calibration.fit import Fit
from facetcam.calibration.least_squares import minimise
from facetcam.calibration.problem import Looks, State, linearise, subset

Array = NDArray[np.float64]

LEAST_CORNERS = 6  # that give a rig pose


@dataclass(frozen=True, eq=False)
class AcrossViews:
    """Corners in the views that did not give the pose.

    Attributes
    ----------
    residuals : (N, 2) array
        Seen minus predicted, pixels.
    variances : (N,) array
        What the squared length of each is on average: noise, the pose's covariance and the rig's.
    """

    residuals: Array
    variances: Array

    @classmethod
    def joined(cls, parts: list[Self]) -> AcrossViews:
        """All of several."""
        return AcrossViews(
            np.concatenate([np.empty((0, 2)), *(p.residuals for p in parts)]),
            np.concatenate([np.empty(0), *(p.variances for p in parts)]),
        )

    @property
    def expected_rms(self) -> float:
        """Root mean square that the residuals should have; NaN without any."""
        return float(np.sqrt(self.variances.mean())) if len(self.variances) else float("nan")


def across_views(part: Fit, shared: Array, noise: float) -> AcrossViews:
    """Residuals in the views of photos when the pose comes from another: the one that shows the most.

    Parameters
    ----------
    part : Fit
        Of photos on which the lens, mirrors and boards do not depend.
    shared : (G, G) array
        Covariance of all shared parameters, held ones zero.
    noise : float
        Pixels that a corner coordinate of a usual sighting is good to.
    """
    found = []
    looks = part.looks.only(part.kept)
    count = np.bincount(looks.sighting, minlength=len(looks.view))
    for station in np.unique(looks.station):
        here = np.flatnonzero(looks.station == station)
        views = looks.view[here]
        best = max(np.unique(views), key=lambda v: int(count[here[views == v]].sum()))
        one, others = here[views == best], here[views != best]
        if count[one].sum() >= LEAST_CORNERS and count[others].sum():
            found.append(_from_one(part, looks, one.tolist(), others.tolist(), shared, noise))
    return AcrossViews.joined(found)


def _from_one(
    part: Fit, looks: Looks, one: list[int], others: list[int], shared: Array, noise: float
) -> AcrossViews:
    known, state, _ = subset(looks, part.state, one)
    state = minimise(state, known, np.zeros_like(part.free), part.prior, None, 30)
    judged, _, _ = subset(looks, part.state, others)
    by_rig, by_pose = _slopes(state, known)
    by_rig_there, by_pose_there = _slopes(state, judged)
    weight = np.repeat(1.0 / (noise * known.noise) ** 2, 2)[:, None]
    pose: Array = np.asarray(np.linalg.pinv(by_pose.T @ (weight * by_pose)), dtype=np.float64)
    # A wrong rig also turns the pose: it is fitted with that rig to what the one view saw.
    through = by_rig_there - by_pose_there @ (pose @ (by_pose.T @ (weight * by_rig)))
    variances = _diagonal(through, shared) + _diagonal(by_pose_there, pose)
    variances += np.repeat((noise * judged.noise) ** 2, 2)
    return AcrossViews(judged.pixels - state.predict(judged), variances.reshape(-1, 2).sum(axis=1))


def _slopes(state: State, looks: Looks) -> tuple[Array, Array]:
    """Derivatives of pixel coordinates by the shared parameters (2N, G) and by the one pose (2N, 6)."""
    linear = linearise(state, looks)
    by_shared = np.empty((len(looks.pixels), 2, state.shared))
    for view, board, (first, last) in zip(looks.view, looks.board, looks.bounds):
        columns = np.r_[linear.columns[view], state.first_board + 6 * board + np.arange(6)]
        # A chain may meet one mirror twice: its columns then repeat and are summed.
        place = np.eye(state.shared)[columns]
        by_shared[first:last] = linear.shared[first:last] @ place
    return by_shared.reshape(-1, state.shared), linear.station.reshape(-1, 6)


def _diagonal(J: Array, covariance: Array) -> Array:
    """Diagonal of J C J'."""
    return np.asarray(np.einsum("ij,ij->i", J @ covariance, J))
