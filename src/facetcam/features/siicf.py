"""SIICF: scale and illumination invariant corner features.

Source: J. Ryu et al., "Multi-view single camera and scale and illumination invariant corner feature",
equations 1-5. The robust mode keeps the paper's idea, intensity change before a multi-scale Harris detector,
and puts the change where it has an effect: eta inside a logarithm.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from facetcam import _core
from facetcam.errors import ConfigError
from facetcam.features.detector import Detector, require
from facetcam.features.images import Image, Mask
from facetcam.features.keypoints import Keypoints

_NO_TABLE = np.zeros(0, np.float32)


@dataclass(frozen=True, slots=True)
class SIICFOptions:
    """Parameters of the robust mode.

    Attributes
    ----------
    max_features : int or None
        The strongest are kept; None keeps all.
    scales : int
        Number of octaves.
    spread : int
        0 keeps the strongest anywhere. Otherwise the side in pixels of square cells: the best of every cell
        comes first, then every second best, and so on.
    eta : float
        Intensity added inside the logarithm, where the median grey value is 64; more damps dark noise.
    sigma, window : float
        Gaussians before the gradient (differentiation scale) and over its products (integration scale),
        pixels of the octave.
    coarse_weight : float
        Weight of the response of the next coarser scale in the sum over scales.
    compression : float
        Gradients g become g / sqrt(|g| + compression); 0 leaves them.
    alpha : float
        Of Harris' det H - alpha trace^2 H, equation 5.
    threshold : float
        Least response. Responses come from gradients of the logarithm, so this is a contrast and does not
        depend on the light; lower it to get more, weaker corners.
    suppression : int
        Half width of the window in which a corner must be the maximum, pixels of the octave.
    border : int
        No corner nearer than this to the edge of the image, pixels.
    oriented : bool
        Give corners the direction to the centroid of their neighbourhood; otherwise 0 (upright).
    threads : int
        0 takes as many as OpenCV, `cv2.getNumThreads()`.
    """

    mode: Literal["robust", "paper"] = "robust"
    max_features: int | None = 1000
    scales: int = 3
    spread: int = 0
    eta: float = 64.0
    sigma: float = 1.2
    window: float = 1.5
    coarse_weight: float = 0.7
    compression: float = 0.05
    alpha: float = 0.01
    threshold: float = 0.02
    suppression: int = 2
    border: int = 4
    oriented: bool = True
    threads: int = 0

    def __post_init__(self) -> None:
        if self.max_features is not None:
            require("SIICF", "max_features", self.max_features, 1)
        limits = {
            "scales": (1, 8),
            "spread": (0, np.inf),
            "eta": (1, 1e6),
            "sigma": (0.3, 4.0),
            "window": (0.5, 4.0),
            "compression": (0.0, np.inf),
            "alpha": (0.0, 0.24),
            "threshold": (0.0, np.inf),
            "suppression": (1, 8),
            "coarse_weight": (0.0, 10.0),
            "border": (0, np.inf),
            "threads": (0, 1024),
        }
        for name, (low, high) in limits.items():
            require("SIICF", name, getattr(self, name), low, high)
        if self.mode not in ("robust", "paper"):
            raise ConfigError(f"SIICF: mode must be 'robust' or 'paper', got {self.mode!r}")


class SIICF(Detector):
    """Corners that stay under changing light and scale."""

    Options = SIICFOptions
    options: SIICFOptions

    def _detect(self, grey: Image, mask: Mask | None) -> Keypoints:
        options = self.options
        if grey.dtype == np.float32:
            grey, table = _log_of_floats(grey, mask, options.eta), _NO_TABLE
        else:
            table = _core.transfer_table(grey, mask, options.eta)
        rows = _core.detect_corners(
            grey,
            mask,
            table,
            scales=options.scales,
            sigma=options.sigma,
            window=options.window,
            alpha=options.alpha,
            compression=options.compression,
            coarse_weight=options.coarse_weight,
            threshold=options.threshold,
            suppression=options.suppression,
            max_features=options.max_features or 0,
            cell=options.spread,
            border=options.border,
            oriented=options.oriented,
            threads=options.threads or cv2.getNumThreads(),
        )
        return Keypoints.from_rows(rows)


def _log_of_floats(grey: Image, mask: Mask | None, eta: float) -> Image:
    """Do to float images what `_core.transfer_table` does to grey values; the range stands for 255 steps."""
    seen = grey if mask is None else grey[mask > 0]
    if seen.size == 0:
        return np.zeros_like(grey)
    black, median = np.quantile(seen, (0.01, 0.5))
    unit = float(np.ptp(seen)) / 255.0
    if unit == 0.0:
        return np.zeros_like(grey)
    scaled = 64.0 * (grey.astype(np.float64) - black) / (median - black + unit)
    return np.asarray(np.log(np.maximum(scaled, 1.0 - eta) + eta), np.float32)
