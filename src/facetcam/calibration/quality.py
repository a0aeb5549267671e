"""How good a calibration was found to be: the numbers of its judges."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from facetcam.calibration.result import Finding

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MirrorDeviation:
    """How far a mirror as built stands from the drawing: tilt in degrees, shift along its normal in mm.

    The sigmas are NaN where the photos do not determine the mirror.
    """

    mirror: str
    tilt_deg: float
    shift_mm: float
    tilt_sigma_deg: float
    shift_sigma_mm: float


@dataclass(frozen=True, eq=False)
class UncertaintyMap:
    """Uncertainty of one view on a grid of raw-frame pixels.

    Attributes
    ----------
    view : str
    u, v : (H, W) arrays
        Pixels of the grid.
    sigma_px : (H, W) array
        Standard deviation of where a point at `depth` is seen, worst direction; NaN outside the view.
    sigma_mm : (H, W) array
        The same across the ray at `depth`, in millimetres.
    depth : float
        Metres from the view's centre.
    """

    view: str
    u: Array
    v: Array
    sigma_px: Array
    sigma_mm: Array
    depth: float


@dataclass(frozen=True)
class Flatness:
    """Plane model (3 parameters a mirror) against free view poses (6 a view).

    A free fit that is better than its additional parameters explain says that mirrors are not flat, or that
    the chains of the rig file are not those of the rig.
    """

    plane_rms: float
    free_rms: float
    ratio: float  # of the drop in weighted cost to what flat mirrors would give, about 1 when flat
    flat: bool
    worst_view: str  # without which the others are flattest; empty where flat, or where it cannot be told


@dataclass(frozen=True, eq=False)
class Validation:
    """How good a calibration is, judged by photos that it has not seen.

    Attributes
    ----------
    held_out_rms : float
        Pixels, over photos that were solved without and in which only the rig pose was free.
    held_out : mapping of photo to float
        The same a photo.
    cross_view_rms : float
        Pixels, when the pose of a held-out photo comes from one view and is judged in its others; NaN where
        no photo shows boards in two views.
    cross_view_expected : float
        What noise and the covariances of that pose and of the rig foretell for it: about the same if the
        model is right. A small board fixes a pose badly, so that both may be far above the residuals.
    cross_view : mapping of photo to float
    split_half_rms : float
        Pixels between the projections of two rigs, each solved from half of the photos, after the best rigid
        alignment of their frames; NaN where halves are too small to solve.
    split_half : mapping of view to float
    flatness : Flatness or None
    deviations : tuple of MirrorDeviation
    maps : tuple of UncertaintyMap
    """

    held_out_rms: float
    held_out: Mapping[int, float]
    cross_view_rms: float
    cross_view_expected: float
    cross_view: Mapping[int, float]
    split_half_rms: float
    split_half: Mapping[str, float]
    flatness: Flatness | None
    deviations: tuple[MirrorDeviation, ...]
    maps: tuple[UncertaintyMap, ...]
    findings: tuple[Finding, ...] = field(default=())
