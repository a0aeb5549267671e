"""Descriptors on the same SIICF corners: mean matching accuracy on real sets and under known changes."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from _common import data_folder, photographs, show

from facetcam.evaluation.datasets import find_sequences
from facetcam.evaluation.detectors import Pair, score_pairs
from facetcam.evaluation.peers import Peer, peers
from facetcam.evaluation.synthetic import changes
from facetcam.features import SIICF, Keypoints
from facetcam.features.descriptors import Described
from facetcam.features.images import Image

SETS = ("leuven", "ubc", "bark", "graf")
PHOTOGRAPHS = 10
BITS = cv2.NORM_HAMMING


def by_opencv(extractor: Any) -> Callable[[Image, Keypoints], Described]:
    """A descriptor of OpenCV as a function of the image and its corners."""

    def compute(image: Image, keypoints: Keypoints) -> Described:
        kept, descriptors = extractor.compute(image, keypoints.to_cv2())
        return Keypoints.from_cv2(kept), descriptors

    return compute


def on_corners(compute: Callable[[Image, Keypoints], Described], norm: int) -> Peer:
    """SIICF corners with a descriptor."""
    corners = SIICF.create(max_features=1000)
    return Peer(corners.detect, lambda image, top: compute(image, corners.detect(image)[:top]), norm)


def compared() -> dict[str, Peer]:
    """Descriptors on SIICF corners (ours, and "by" others), then whole detectors with their own."""
    extra = cv2.xfeatures2d
    teblid, beblid = (extra.TEBLID, extra.TEBLID_SIZE_512_BITS), (extra.BEBLID, extra.BEBLID_SIZE_512_BITS)
    ours = {
        "gradients": (SIICF.create(descriptor="gradients").compute, cv2.NORM_L2),
        "binary": (SIICF.create(descriptor="binary").compute, BITS),
        "TEBLID512": (by_opencv(teblid[0].create(3.5, teblid[1])), BITS),
        "BEBLID512": (by_opencv(beblid[0].create(3.5, beblid[1])), BITS),
        "by SIFT": (by_opencv(cv2.SIFT.create()), cv2.NORM_L2),
        "by ORB": (by_opencv(cv2.ORB.create()), BITS),
    }
    return {name: on_corners(*how) for name, how in ours.items()} | peers(["SIFT", "AKAZE", "ORB"])


def sets() -> dict[str, list[Pair]]:
    """Pairs of images by set: Oxford's, and photographs of a kitchen changed in known ways."""
    found: dict[str, list[Pair]] = {}
    for name in SETS:
        sequence = next(find_sequences(data_folder() / "oxford" / name))
        first, *others = sequence.images()
        found[name] = [(first, other, H) for other, H in zip(others, sequence.homographies, strict=True)]
    images = photographs(PHOTOGRAPHS)
    for name, change in changes().items():
        found[name] = [(image, *change(image)) for image in images]
    return found


def milliseconds(peer: Peer, image: Image) -> float:
    """Processor time to find and describe 1000 points, the least of five."""
    times = []
    for _ in range(5):
        start = time.process_time()
        peer.described(image, 1000)
        times.append(time.process_time() - start)
    return 1000 * min(times)


def main() -> None:
    cv2.setNumThreads(1)
    pairs, peers_of = sets(), compared()
    scores = {
        name: {of_set: score_pairs(found, peer, "D", 1000) for of_set, found in pairs.items()}
        for name, peer in peers_of.items()
    }
    rows = [(of_set, *(f"{scores[name][of_set]['D MMA@3']:.3f}" for name in peers_of)) for of_set in pairs]
    for key in ("D MMA@1", "D MMA@3", "D MMA@5"):
        means = [np.mean([found[key] for found in scores[name].values()]) for name in peers_of]
        rows.append((f"mean {key[2:]}", *(f"{mean:.3f}" for mean in means)))
    image = pairs["leuven"][0][0]
    rows.append(("ms, leuven", *(f"{milliseconds(peer, image):.0f}" for peer in peers_of.values())))
    show("MMA@3, top 1000", ("set", *peers_of), rows)


if __name__ == "__main__":
    main()
