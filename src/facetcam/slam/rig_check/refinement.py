"""Refining the rig's own numbers from the map, held by what its calibration or its build leaves open."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from facetcam.rig import Rig, RigCovariance
from facetcam.rig.freedom import moved, tolerance
from facetcam.slam.adjustment.adjuster import Adjuster
from facetcam.slam.adjustment.bundle import Bundle
from facetcam.slam.adjustment.information import information
from facetcam.slam.camera.optics import Optics
from facetcam.slam.map.map import Map

Array = NDArray[np.float64]

_ROUNDS = 6
_MOST_MOVED = 3.0  # standard deviations
_SMALL_STEP = 0.02  # standard deviations at which to stop
_NULL = 1e-10  # information below this share of the largest is rounding
_LEAST_KEYFRAMES = 5


@dataclass(frozen=True, eq=False, slots=True)
class RigRefinement:
    """A rig after refinement; its covariance is what is still open.

    Attributes
    ----------
    rig : Rig
    before : RigCovariance
        What was open before.
    shift : (P,) array
        By how much each number of `before` moved, in its standard deviations.
    """

    rig: Rig
    before: RigCovariance
    shift: Array

    @property
    def moved(self) -> dict[str, float]:
        """Shift of each number in standard deviations, by name."""
        return {name: float(s) for name, s in zip(self.before.parameters, self.shift)}

    @property
    def complaint(self) -> str:
        """What is wrong, for people; empty while the rig stays within what was open of it.

        Where it does not, what was said to be known of it is wrong, and so is what holds the scale.
        """
        row = int(np.argmax(np.abs(self.shift)))
        if abs(self.shift[row]) < _MOST_MOVED:
            return ""
        return (
            f"the refined rig is far from the file's ({self.before.parameters[row]} moved by"
            f" {abs(self.shift[row]):.0f} standard deviations of what was open of it), so the scale is not"
            " proven; calibrate the rig (facetcam calibrate)"
        )


def refine_rig(map: Map, optics: Optics, adjuster: Adjuster, pixel_sigma: float) -> RigRefinement | None:
    """Find the rig that explains the map best, and adjust the map with it; None if the map is too small.

    Each round takes the Gauss-Newton step of the rig's numbers in the joint problem of rig, poses and points,
    then lets poses and points settle.
    """
    whole = adjuster.whole()
    if whole is None or len(map.keyframes) < _LEAST_KEYFRAMES:
        return None
    before = optics.rig.covariance or tolerance(optics.rig)
    sigma = np.sqrt(np.diag(before.matrix))
    shift, rig = np.zeros(len(sigma)), replace(optics.rig, covariance=before)
    for _ in range(_ROUNDS):
        known = rig.covariance or before
        H, gradient, prior = rig_equations(adjuster.whole() or whole, optics, pixel_sigma, known)
        step = -np.linalg.solve(H + prior, gradient + prior @ shift)
        rig, shift = moved(rig, known, sigma * step), shift + step
        _take_up(map, optics, rig)
        adjuster.adjust_all(last=True)
        if np.abs(step).max() < _SMALL_STEP:
            break
    left = np.linalg.inv(H + prior) * np.outer(sigma, sigma)
    axes = (rig.covariance or before).axes
    rig = replace(rig, covariance=RigCovariance(before.parameters, 0.5 * (left + left.T), axes))
    _take_up(map, optics, rig)
    return RigRefinement(rig, before, shift)


def rig_equations(
    whole: Bundle, optics: Optics, pixel_sigma: float, known: RigCovariance
) -> tuple[Array, Array, Array]:
    """Equations of the rig's numbers in standard deviations, with points and poses eliminated.

    Returns
    -------
    information, gradient : (R, R), (R,) arrays
    prior : (R, R) array
        Information of what is known of them.
    """
    if whole.nuisances is not None and "cx" in known.parameters:
        whole = replace(whole, nuisances=whole.nuisances.of_readout())
    found = information(whole, optics, pixel_sigma, known)
    values, vectors = np.linalg.eigh(found.poses[6:, 6:])  # the first frame is held
    seen = values > _NULL * values[-1]
    spread = vectors[:, seen] / np.sqrt(values[seen])
    through = spread.T @ found.joint[6:]
    H = found.rig - through.T @ through
    sigma = np.sqrt(np.diag(known.matrix))
    prior = np.linalg.inv(known.matrix / np.outer(sigma, sigma) + 1e-9 * np.eye(len(sigma)))
    return 0.5 * (H + H.T), found.rig_gradient - through.T @ (spread.T @ found.pose_gradient[6:]), prior


def _take_up(map: Map, optics: Optics, rig: Rig) -> None:
    """Go over to another rig; what was seen lies elsewhere on its ideal pinholes."""
    with map.lock:
        optics.take_up(rig)
        map.creep = np.zeros(2)  # it is the rig's own now
        map.see_through(optics)
