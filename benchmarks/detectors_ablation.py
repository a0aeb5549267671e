"""SIICF with one ingredient changed at a time, with other thresholds, and spread evenly: protocol B.

The threshold decides how many weak corners take part in the top 1000, so ingredients are better compared by
the top 300, in which it plays no part.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from _common import data_folder, photographs, show

from facetcam.evaluation.datasets import find_sequences
from facetcam.evaluation.detectors import Pair, score_pairs
from facetcam.evaluation.peers import Peer
from facetcam.evaluation.synthetic import changes
from facetcam.features import SIICF, describe
from facetcam.features.images import Image

VARIANTS: dict[str, dict[str, Any]] = {
    "default": {},
    "no threshold": {"threshold": 0.0},
    "eta 1e5: no logarithm": {"eta": 1e5},
    "eta 32": {"eta": 32.0},
    "gradients hardly compressed": {"compression": 0.5},
    "gradients compressed more": {"compression": 0.01},
    "one scale": {"scales": 1},
    "two scales": {"scales": 2},
    "four scales": {"scales": 4},
    "coarse scales weigh 0.5": {"coarse_weight": 0.5},
    "coarse scales weigh 1.5": {"coarse_weight": 1.5},
    "window 1.2": {"window": 1.2},
    "alpha 0": {"alpha": 0.0},
    "alpha 0.04": {"alpha": 0.04},
    "suppression 3x3": {"suppression": 1},
    "suppression 7x7": {"suppression": 3},
    "paper mode": {"mode": "paper"},
}
SETS = ("leuven", "ubc", "bark", "graf")
THRESHOLDS = (0.0, 0.01, 0.015, 0.019, 0.025, 0.03, 0.04)
SPREADS = (0, 80, 40, 20)  # sides of cells, pixels
SPREAD_CORNERS = 500


def with_options(max_features: int | None = None, **options: Any) -> Peer:
    """All corners, or the best, that SIICF finds with these options."""
    detector = SIICF.create(max_features=max_features, **options)
    return Peer(detector.detect, lambda image, top: describe(image, top))


def ingredients(pairs: list[list[Pair]]) -> None:
    rows = []
    for name, options in VARIANTS.items():
        peer = with_options(**options)
        best = [score_pairs(of_set, peer, "B", 1000) for of_set in pairs]
        few = [score_pairs(of_set, peer, "B", 300)["B"] for of_set in pairs]
        scores = [f"{found['B']:.3f}" for found in best]
        points = f"{np.mean([found['points'] for found in best]):.0f}"
        mean = f"{np.mean([found['B'] for found in best]):.3f}"
        rows.append((name, *scores, mean, points, f"{np.mean(few):.3f}", f"{best[0]['B px']:.2f}"))
    columns = ("SIICF with", *SETS, "mean", "points", "top 300", "leuven px")
    show("Protocol B, top 1000", columns, rows)


def thresholds(pairs: list[list[Pair]]) -> None:
    """The half shadow is on 20 indoor photographs, top 500."""
    shadow = [(image, *changes()["half shadow"](image)) for image in photographs()]
    rows = []
    for threshold in THRESHOLDS:
        peer = with_options(threshold=threshold)
        scores = [score_pairs(of_set, peer, "B", 1000)["B"] for of_set in pairs]
        shadowed = score_pairs(shadow, peer, "B", 500)["B"]
        corners = np.mean([len(peer.detect(first)) for first, *_ in shadow])
        numbers = [f"{score:.3f}" for score in (*scores, np.mean(scores), shadowed)]
        rows.append((f"{threshold:g}", *numbers, f"{corners:.0f}"))
    columns = ("threshold", *SETS, "mean", "half shadow", "corners in a photograph")
    show("Protocol B by threshold", columns, rows)


def spreads(pairs: list[list[Pair]]) -> None:
    """The strongest corners anywhere against those spread evenly, and how much of a picture they reach."""
    rows = []
    for side in SPREADS:
        peer = with_options(SPREAD_CORNERS, spread=side)
        scores = [score_pairs(of_set, peer, "B", SPREAD_CORNERS)["B"] for of_set in pairs]
        reached = np.mean([reach(peer, of_set[0][0]) for of_set in pairs])
        numbers = [f"{score:.3f}" for score in (*scores, np.mean(scores))]
        rows.append((f"cells of {side}" if side else "none", *numbers, f"{reached:.0%}"))
    show(f"Protocol B, best {SPREAD_CORNERS} by even spread", ("spread", *SETS, "mean", "picture"), rows)


def reach(peer: Peer, image: Image, near: float = 20.0) -> float:
    """Share of the pixels that have a corner near."""
    empty = np.ones(image.shape, np.uint8)
    x, y = np.rint(peer.detect(image).xy).astype(int).T
    empty[y, x] = 0
    return float(np.mean(cv2.distanceTransform(empty, cv2.DIST_L2, 5) <= near))


def main() -> None:
    pairs: list[list[Pair]] = []
    for name in SETS:
        sequence = next(find_sequences(data_folder() / "oxford" / name))
        first, *others = sequence.images()
        pairs.append([(first, other, H) for other, H in zip(others, sequence.homographies, strict=True)])
    ingredients(pairs)
    thresholds(pairs)
    spreads(pairs)


if __name__ == "__main__":
    main()
