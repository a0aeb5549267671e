"""Repeatability (protocol B, top 500) of detectors on 20 indoor photographs under known changes."""

from __future__ import annotations

import cv2
from _common import data_folder, show

from facetcam.evaluation.detectors import evaluate_change
from facetcam.evaluation.peers import peers
from facetcam.evaluation.synthetic import changes

NAMES = ["SIICF", "SIICF all", "GFTT", "FAST", "ORB", "SIFT", "AKAZE", "BRISK"]


def main() -> None:
    photographs = sorted((data_folder() / "kitchen").glob("*.jpg"))
    chosen = photographs[:: len(photographs) // 20][:20]
    images = [cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in chosen]
    compared = peers(NAMES)
    rows = []
    for change, function in changes().items():
        scores = [
            evaluate_change(images, change, function, name, peer, "B").scores["B"]
            for name, peer in compared.items()
        ]
        rows.append((change, *(f"{score:.3f}" for score in scores)))
    show("Protocol B, top 500, 20 photographs", ("change", *compared), rows)


if __name__ == "__main__":
    main()
