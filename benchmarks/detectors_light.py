"""Repeatability (protocol B) of detectors under light that changes in known ways."""

from __future__ import annotations

import numpy as np
from _common import data_folder, photographs, show

from facetcam.evaluation.datasets import find_sequences
from facetcam.evaluation.detectors import evaluate_change, score_pairs
from facetcam.evaluation.peers import peers
from facetcam.evaluation.synthetic import changes

NAMES = ["SIICF", "SIICF all", "GFTT", "FAST", "ORB", "SIFT", "AKAZE", "BRISK"]


def under_changes() -> None:
    """Twenty indoor photographs against changed copies, top 500."""
    images = photographs()
    compared = peers(NAMES)
    rows = []
    for change, function in changes().items():
        scores = [
            evaluate_change(images, change, function, name, peer, "B").scores["B"]
            for name, peer in compared.items()
        ]
        rows.append((change, *(f"{score:.3f}" for score in scores)))
    show("Protocol B, top 500, 20 photographs", ("change", *compared), rows)


def gains() -> None:
    """Pairs of Oxford images, the second as it is and with a gain on top, top 1000."""
    rows = []
    for name in ("leuven", "bark", "graf", "ubc"):
        sequence = next(find_sequences(data_folder() / "oxford" / name))
        first, *others = sequence.images()
        for gain in ("none", "gain 1/4", "gain 4"):
            change = changes().get(gain, lambda image: (image, np.eye(3)))
            seconds = [change(image)[0] for image in others]
            pairs = [(first, image, H) for image, H in zip(seconds, sequence.homographies, strict=True)]
            clipped = np.mean([np.mean(image == 255) for image in seconds])
            scores = [score_pairs(pairs, peer, "B", 1000)["B"] for peer in peers(NAMES).values()]
            rows.append((name, gain, f"{clipped:.0%}", *(f"{score:.3f}" for score in scores)))
    show("Protocol B, top 1000, gain on the second image", ("set", "gain", "clipped", *NAMES), rows)


def main() -> None:
    under_changes()
    gains()


if __name__ == "__main__":
    main()
