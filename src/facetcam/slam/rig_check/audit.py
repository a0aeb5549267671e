"""What a map says of the rig that it was made with, and what its metre is worth after a drawing."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from facetcam.rig.freedom import tolerance
from facetcam.slam.adjustment.adjuster import Adjuster
from facetcam.slam.adjustment.map_uncertainty import map_uncertainty
from facetcam.slam.camera.optics import Optics
from facetcam.slam.rig_check.refinement import rig_equations

Array = NDArray[np.float64]

# By chance free numbers gain about the root of their count (16-22), and more where errors are shared: true
# rigs gain up to 4 in films of the house, 8 in rooms of coarse patterns; in the house a lens wrong by 1 %
# gains 13 to 28.
_HARDLY_BY_CHANCE, _NOTABLE = 7.0, 0.5  # and how far a number moves then, of what a careful build leaves open
_PERHAPS, _FAR = 5.0, 2.0  # the same of numbers that move farther than those of true rigs (1.3 at most)
_SURE = 9.0  # however little it moves


@dataclass(frozen=True, slots=True)
class RigAudit:
    """How far the images want another rig, given how rigs are built.

    Attributes
    ----------
    moved : dict of str to float
        By how much they would move each number of the rig, in standard deviations of a careful build
        (`facetcam.rig.freedom.tolerance`).
    gain : float
        Root of the chi square by which the moved rig explains them better than one within the covariance of
        the rig's file does, which is exact where it has none.
    """

    moved: dict[str, float]
    gain: float

    @property
    def worst(self) -> str:
        """Number of the rig that would move most."""
        return max(self.moved, key=lambda name: abs(self.moved[name]))

    @property
    def denies(self) -> bool:
        """True where the images are sure of another rig."""
        most = abs(self.moved[self.worst])
        notable = self.gain > _HARDLY_BY_CHANCE and most > _NOTABLE
        return notable or self.gain > _SURE or (self.gain > _PERHAPS and most > _FAR)

    @property
    def complaint(self) -> str:
        """What is wrong, for people; empty while nothing is."""
        if not self.denies:
            return ""
        return (
            f"the map fits clearly better with another rig ({self.worst} moves by"
            f" {abs(self.moved[self.worst]):.1f} standard deviations of a careful build), so its scale is not"
            " proven; calibrate the rig (facetcam calibrate), or refine it with the map (--refine-rig)"
        )


def audit_rig(optics: Optics, adjuster: Adjuster, pixel_sigma: float) -> RigAudit | None:
    """Ask what rig a map wants, by one Gauss-Newton step that leaves all as it is; None without a map."""
    whole = adjuster.whole()
    if whole is None:
        return None
    built, own = tolerance(optics.rig), optics.rig.covariance
    step, gain = _asked_for(rig_equations(whole, optics, pixel_sigma, built))
    if own is not None:
        gain -= _asked_for(rig_equations(whole, optics, pixel_sigma, own))[1]
    moved = {name: float(s) for name, s in zip(built.parameters, step)}
    return RigAudit(moved, math.sqrt(max(gain, 0.0)))


def _asked_for(equations: tuple[Array, Array, Array]) -> tuple[Array, float]:
    """Step of the rig's numbers, and the chi square that it gains."""
    H, gradient, prior = equations
    step = np.asarray(-np.linalg.solve(H + prior, gradient))
    return step, -float(gradient @ step)


def drawn_scale_sigma(optics: Optics, adjuster: Adjuster, pixel_sigma: float) -> float | None:
    """Relative standard deviation of the scale if the rig was built with care after its drawing.

    A file without a covariance counts as exact otherwise; None for a rig with one of its own.
    """
    whole = adjuster.whole()
    if whole is None or optics.rig.covariance is not None:
        return None
    drawn = replace(optics.rig, covariance=tolerance(optics.rig))
    return map_uncertainty(whole, optics.adapted(drawn), pixel_sigma).scale_sigma
