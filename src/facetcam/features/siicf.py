"""SIICF: scale and illumination invariant corner features.

Source: J. Ryu et al., "Multi-view single camera and scale and illumination invariant corner feature",
equations 1-5. The robust mode keeps the paper's idea, intensity change before a multi-scale Harris detector,
and puts the change where it has an effect: eta inside a logarithm.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from facetcam import _core
from facetcam.errors import ConfigError
from facetcam.features.descriptors import description
from facetcam.features.detector import MOST_FEATURES, Detector, require
from facetcam.features.images import Image, Mask
from facetcam.features.keypoints import Keypoints
from facetcam.features.paper import PaperParameters, paper_rows
from facetcam.features.peaks import strongest

MODES = {"robust": (0.01, 0.019), "paper": (0.04, 500.0)}  # alpha, threshold

_NO_TABLE = np.zeros(0, np.int16)
_VALUE_UNIT, _LARGEST, _MIDDLE = 512.0, 1023.0, 1.7  # fixed point of cpp/corner_kernels.hpp and light.cpp
_LIMITS = {
    "scales": (1, 8),
    "sigma": (0.3, 4.0),
    "alpha": (0.0, 0.24),
    "threshold": (0.0, np.inf),
    "spread": (0, 1e6),
    "eta": (1, 1e6),
    "black": (-1e6, 1e6),
    "window": (0.85, 4.0),
    "coarse_weight": (0.0, 10.0),
    "compression": (0.0, 1.0),
    "suppression": (1, 8),
    "border": (0, 1e6),
    "threads": (0, 1024),
    "levels": (1, 8),
    "k": (1.05, 3.0),
}


@dataclass(frozen=True, slots=True)
class SIICFOptions:
    """Parameters of SIICF.

    Attributes
    ----------
    mode : str
        "robust", or "paper": equations 1-5 as printed. Parameters of one mode only are marked.
    max_features : int or None
        The strongest are kept; None keeps all.
    scales : int
        Number of octaves (in the paper: of down-sampled images).
    sigma : float
        Gaussian before the gradient (differentiation scale), pixels of the octave.
    alpha : float
        Of Harris' det H - alpha trace^2 H, equation 5; None takes 0.01 (robust) or 0.04 (paper).
    threshold : float
        Least response; None takes 0.019 (robust) or 500 (paper). A robust response comes from gradients of
        the logarithm, so this is a contrast whatever the light; lower it for more, weaker corners.
    spread : int
        Robust: 0 keeps the strongest anywhere. Otherwise the side in pixels of square cells: the best of
        every cell comes first, then every second best, and so on.
    eta : float
        Robust: intensity added inside the logarithm, where the median grey value is 64; more damps dark
        noise. The slope at the median, and with it the meaning of the threshold, does not depend on it.
    black : float or None
        Robust: grey value of no light; None takes the darkest hundredth of the pixels that may hold corners.
        Give it where these show but a part of the picture: a bare wall has nothing dark.
    window : float
        Robust: Gaussian over the products of gradients (integration scale), pixels of the octave.
    coarse_weight : float
        Robust: weight of the squared response of the next coarser octave in the sum over octaves.
    compression : float
        Robust: gradients g become g / (g^2 + compression^2)^(1/4), up to a factor that keeps a gradient of
        0.05 as strong as it is with a compression of 0.05; the larger, the less are strong ones tamed.
    suppression : int
        Robust: half width of the window in which a corner must be the maximum, pixels.
    border : int
        Robust: no corner nearer than this to the edge of the image, pixels.
    oriented : bool
        Robust: give corners the direction of the gradient round them; otherwise 0 (upright).
    descriptor : str
        What `compute` gives: "gradients" match best, "binary" are small and quick; see `describe`.
    threads : int
        Robust: 0 takes as many as OpenCV, `cv2.getNumThreads()`. The result does not depend on it.
    levels, k : int, float
        Paper: Gaussian scales in each octave, and the ratio between them.
    etas : tuple of float
        Paper: intensity changes; a corner must be a local maximum in most of the changed images.
    """

    mode: str = "robust"
    max_features: int | None = 1000
    scales: int = 3
    sigma: float = 1.2
    alpha: float | None = None
    threshold: float | None = None
    spread: int = 0
    eta: float = 64.0
    black: float | None = None
    window: float = 1.5
    coarse_weight: float = 1.0
    compression: float = 0.05
    suppression: int = 2
    border: int = 4
    oriented: bool = True
    descriptor: str = "gradients"
    threads: int = 0
    levels: int = 3
    k: float = 1.4
    etas: tuple[float, ...] = (-60.0, -30.0, 0.0, 30.0, 60.0)

    def __post_init__(self) -> None:
        if self.mode not in MODES:
            raise ConfigError(f"SIICF: mode must be one of {', '.join(MODES)}, got {self.mode!r}")
        description(self.descriptor)
        if self.max_features is not None:
            require("SIICF", "max_features", self.max_features, 1)
        for name, (low, high) in _LIMITS.items():
            if (value := getattr(self, name)) is not None:
                require("SIICF", name, value, low, high)
        if not self.etas:
            raise ConfigError("SIICF: etas must hold at least one number, got none")
        for eta in self.etas:
            require("SIICF", "etas", eta, -255.0, 255.0)

    def measure(self) -> tuple[float, float]:
        """Alpha and threshold, the mode's own where they are None."""
        alpha, threshold = MODES[self.mode]
        return (
            alpha if self.alpha is None else self.alpha,
            threshold if self.threshold is None else self.threshold,
        )


class SIICF(Detector):
    """Corners that stay under changing light and scale."""

    Options = SIICFOptions
    options: SIICFOptions

    def _detect(self, grey: Image, mask: Mask | None) -> Keypoints:
        if self.options.mode == "paper":
            return self._detect_paper(grey, mask)
        return self._detect_robust(grey, mask)

    def _detect_paper(self, grey: Image, mask: Mask | None) -> Keypoints:
        o = self.options
        parameters = PaperParameters(o.scales, o.levels, o.sigma, o.k, o.etas, *o.measure())
        return strongest(paper_rows(grey, parameters), mask, o.max_features)

    def _detect_robust(self, grey: Image, mask: Mask | None) -> Keypoints:
        options = self.options
        alpha, threshold = options.measure()
        if grey.dtype == np.float32:
            grey, table = _log_of_floats(grey, mask, options.eta, options.black), _NO_TABLE
        else:
            table = _core.transfer_table(grey, mask, options.eta, options.black)
        rows = _core.detect_corners(
            grey,
            mask,
            table,
            scales=options.scales,
            sigma=options.sigma,
            window=options.window,
            alpha=alpha,
            compression=options.compression,
            coarse_weight=options.coarse_weight,
            threshold=threshold,
            suppression=options.suppression,
            border=options.border,
            max_features=min(options.max_features or 0, MOST_FEATURES),
            cell=options.spread,
            oriented=options.oriented,
            threads=options.threads or cv2.getNumThreads(),
        )
        return Keypoints.from_rows(rows)


def _log_of_floats(grey: Image, mask: Mask | None, eta: float, black: float | None) -> Image:
    """Do to float images what `_core.transfer_table` does to grey values; the range stands for 255 steps."""
    seen = grey if mask is None else grey[mask > 0]
    unit = float(np.ptp(seen)) / 255.0 if seen.size else 0.0
    if unit == 0.0:
        return np.zeros(grey.shape, np.int16)
    darkest, median = np.quantile(seen, (0.01, 0.5))
    black = min(darkest if black is None else black, median)
    lit = np.maximum(64.0 * (grey.astype(np.float64) - black) / (median - black + unit), 1.0 - eta) + eta
    slope = 0.5 * (1.0 + eta / 64.0)
    values = _VALUE_UNIT * (slope * np.log(lit / eta) - _MIDDLE)
    return np.asarray(np.rint(np.clip(values, -_LARGEST, _LARGEST)), np.int16)
