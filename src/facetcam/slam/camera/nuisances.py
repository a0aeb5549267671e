"""What no file says of a film, and what is estimated with the map: the shutter's readout and the rig's creep.

A camera creeps against its mirrors: a lens settles, a holder warms, something bumps into the rig. Its whole
image is then shifted by some tenths of a pixel. Mirrors turn this shift into another direction for each view,
as if the views stood otherwise: a quarter of a pixel may cost a small rig two per cent of its scale.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from facetcam.slam.camera.optics import Optics
from facetcam.slam.camera.shutter import LONGEST_READOUT, READOUT_SIGMA

Array = NDArray[np.float64]
Rows = NDArray[np.bool_]

CREEP_SIGMA = 0.5  # px on the frame, each way, before anything is known
_FARTHEST_CREEP = 3.0  # px
_TOLD = 0.5  # of what was expected of the creep, below which its uncertainty must lie
_CERTAIN = 2.0  # sigmas by which a readout must differ from that of a global shutter
_STEP = 0.5  # px


@dataclass(frozen=True, slots=True)
class Nuisances:
    """Numbers that are estimated with the map, and what they do to each observation.

    Attributes
    ----------
    values : (N,) array
        Seconds of readout, and pixels (x, y) by which the image has crept; the latter for more than one view.
    sigma : (N,) array
        Standard deviations of what is expected of them before anything is seen; the mean is zero.
    by : (M, 2, N) array
        Shift of each observation on the ideal pinholes by one unit of each.
    """

    values: Array
    sigma: Array
    by: Array

    @classmethod
    def of(cls, readout: float, creep: Array, by_readout: Array, by_creep: Array | None) -> Nuisances:
        """The readout with its derivative (M, 2), and the creep if it has one (M, 2, 2)."""
        if by_creep is None:
            return cls(np.array([readout]), np.array([READOUT_SIGMA]), by_readout[:, :, None])
        sigma = np.array([READOUT_SIGMA, CREEP_SIGMA, CREEP_SIGMA])
        by = np.concatenate([by_readout[:, :, None], by_creep], axis=2)
        return cls(np.array([readout, *creep]), sigma, by)

    def believed(self) -> Nuisances:
        """Those that are believed free, the others held at zero."""
        return replace(self, by=self.by * (self.values != 0.0))

    def of_readout(self) -> Nuisances:
        """The readout alone, for a rig whose own principal point moves."""
        return Nuisances(self.values[:1], self.sigma[:1], self.by[:, :, :1])


def shift_by_creep(plane: Array, view: NDArray[np.integer], optics: Optics) -> Array:
    """Shift (N, 2, 2) on the ideal pinholes of observations by a pixel of creep along x and along y."""
    pixels, steps = optics.pixels(plane, view), _STEP * np.eye(2)
    return np.stack(
        [(optics.plane(pixels + s, view) - optics.plane(pixels - s, view)) / (2.0 * _STEP) for s in steps],
        axis=2,
    )


def believed(values: Array, covariance: Array) -> Array:
    """Of estimates (N,) those that count, given that the others are zero: a wrong number bends a young map.

    Readout and creep (3,) come back, zero where they are not estimated. The creep counts once the images have
    told far more of it than was expected before, the readout once it stands out of its own uncertainty, since
    most shutters are global.
    """
    rolls = np.arange(len(values)) < 1
    kept = rolls | (np.linalg.eigvalsh(covariance[1:, 1:]).max(initial=0.0) < (_TOLD * CREEP_SIGMA) ** 2)
    found, spread = _given(values, covariance, kept)
    if not _CERTAIN * np.sqrt(spread[0, 0]) < abs(found[0]) < LONGEST_READOUT:
        found, _ = _given(values, covariance, kept & ~rolls)
    known = np.zeros(3)
    known[0] = found[0]
    if len(found) > 1 and np.all(np.abs(found[1:]) < _FARTHEST_CREEP):
        known[1:] = found[1:]
    return known


def _given(values: Array, covariance: Array, rows: Rows) -> tuple[Array, Array]:
    """Estimates (N,) of some numbers and their covariance (N, N) if the others are zero."""
    weight = np.linalg.inv(covariance)
    found, spread = np.zeros(len(values)), np.zeros_like(covariance)
    spread[np.ix_(rows, rows)] = np.linalg.inv(weight[np.ix_(rows, rows)])
    found[rows] = spread[np.ix_(rows, rows)] @ (weight[rows] @ values)
    return found, spread
