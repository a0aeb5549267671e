"""What a finished map says of the rig that it was made with, and what its metre is worth after a drawing."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from facetcam.rig.freedom import tolerance
from facetcam.slam.adjustment import Adjuster
from facetcam.slam.optics import Optics
from facetcam.slam.rig_refinement import rig_equations
from facetcam.slam.scale import map_uncertainty

# True rigs gain as much as numbers that are free to move do by chance, about the root of their count (16-22),
# and up to half as much again, as errors are shared; a lens wrong by 1 % makes the house's loop gain 14.
_BY_CHANCE = 7.0
_NOTABLE = 0.5  # of what a careful build leaves open


@dataclass(frozen=True, slots=True)
class RigAudit:
    """How far the images want another rig, given how rigs are built.

    Attributes
    ----------
    moved : dict of str to float
        By how much they would move each number of the rig, in standard deviations of a careful build
        (`facetcam.rig.freedom.tolerance`).
    gain : float
        Root of the chi square by which the moved rig explains them better.
    drawn_sigma : float or None
        Relative standard deviation of the scale if the rig was built with care after its drawing, where its
        file counts as exact; None for a rig with a covariance of its own.
    """

    moved: dict[str, float]
    gain: float
    drawn_sigma: float | None

    @property
    def worst(self) -> str:
        """Number of the rig that would move most."""
        return max(self.moved, key=lambda name: abs(self.moved[name]))

    @property
    def denies(self) -> bool:
        """True where the images are sure of another rig."""
        return self.gain > _BY_CHANCE and abs(self.moved[self.worst]) > _NOTABLE

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
    built = tolerance(optics.rig)
    drawn_sigma = None
    if optics.rig.covariance is None:
        drawn = optics.adapted(replace(optics.rig, covariance=built))
        drawn_sigma = map_uncertainty(whole, drawn, pixel_sigma).scale_sigma
    H, gradient, prior = rig_equations(whole, optics, pixel_sigma, built)
    step = -np.linalg.solve(H + prior, gradient)
    moved = {name: float(s) for name, s in zip(built.parameters, step)}
    gain = math.sqrt(max(-float(gradient @ step), 0.0))
    return RigAudit(moved, gain, drawn_sigma)
