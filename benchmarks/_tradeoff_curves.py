"""Curves of `detectors_tradeoffs.py`: repeatability by gain, matching by number of points, time by scales."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from _common import data_folder
from detectors_speed import frame, textured

from facetcam.evaluation.datasets import find_sequences
from facetcam.evaluation.detectors import Pair, score_pairs
from facetcam.evaluation.peers import Peer, peers
from facetcam.features import SIICF, describe
from facetcam.features.images import Image

SETS = ("leuven", "ubc", "bark", "graf")
GAINS = (1.0, 1.5, 2.0, 2.5, 3.0, 4.0)
TOPS = (200, 300, 500, 700, 1000)
TURNS = 30

Curves = dict[str, list[tuple[float, float]]]


def oxford(name: str) -> list[Pair]:
    sequence = next(find_sequences(data_folder() / "oxford" / name))
    first, *others = sequence.images()
    return [(first, other, H) for other, H in zip(others, sequence.homographies, strict=True)]


def under_gain(names: list[str]) -> tuple[list[float], Curves]:
    """Clipped share by gain, and repeatability on leuven with it on the second image over that without."""
    pairs, shares = oxford("leuven"), []
    curves: Curves = {name: [] for name in names}
    for gain in GAINS:
        seconds = [np.clip(np.rint(gain * pair[1]), 0, 255).astype(np.uint8) for pair in pairs]
        shares.append(float(np.mean([np.mean(image == 255) for image in seconds])))
        changed = [(pair[0], image, pair[2]) for pair, image in zip(pairs, seconds, strict=True)]
        for name, peer in peers(names).items():
            score = score_pairs(changed, peer, "B", 1000)["B"]
            curves[name].append((gain, score / curves[name][0][1] if curves[name] else score))
    return shares, {name: [(1.0, 1.0), *curve[1:]] for name, curve in curves.items()}


def by_number() -> Curves:
    """MMA@3 on ubc by the number of points: whole detectors, and our descriptor on AKAZE's points."""
    corners, akaze = SIICF.create(max_features=None), peers(["AKAZE"])["AKAZE"]

    def upright(image: Image, top: int) -> Any:
        points = corners.detect(image)[:top]
        return describe(image, replace(points, angle=np.zeros_like(points.angle)))

    compared = peers(["SIICF", "SIFT", "ORB"]) | {
        "AKAZE": akaze,
        "SIICF, upright": Peer(corners.detect, upright, cv2.NORM_L2),
        "AKAZE's points, our gradients": Peer(
            akaze.detect, lambda image, top: describe(image, akaze.detect(image)[:top]), cv2.NORM_L2
        ),
    }
    pairs = oxford("ubc")
    return {
        name: [(top, score_pairs(pairs, peer, "D", top)["D MMA@3"]) for top in TOPS]
        for name, peer in compared.items()
    }


def least_times(finders: dict[str, Any], images: tuple[Image, ...]) -> dict[str, list[float]]:
    """Milliseconds of each finder on each image, least of many turns, one thread."""
    cv2.setNumThreads(1)
    least = {name: [np.inf] * len(images) for name in finders}
    for _ in range(TURNS):
        for name, finder in finders.items():
            for k, image in enumerate(images):
                start = time.perf_counter()
                finder.detect(image)
                least[name][k] = min(least[name][k], 1000 * (time.perf_counter() - start))
    return least


def by_scales() -> tuple[dict[str, tuple[float, float]], list[tuple[str, ...]]]:
    """Time on the film and mean of protocol B by detector, and the rows of a table."""
    ours = {f"SIICF, scales {n}": SIICF.create(max_features=None, scales=n, threads=1) for n in (1, 2, 3, 4)}
    theirs = {
        "ORB": cv2.ORB.create(),
        "ORB, FAST 5": cv2.ORB.create(1000, fastThreshold=5),  # as in `evaluate detectors`
        "GFTT": cv2.GFTTDetector.create(),
        "AKAZE": cv2.xfeatures2d.AKAZE.create() if hasattr(cv2.xfeatures2d, "AKAZE") else cv2.AKAZE.create(),
        "SIFT": cv2.SIFT.create(),
    }
    least = least_times(ours | theirs, (frame(), textured()))
    pairs, known = [oxford(name) for name in SETS], peers(["ORB", "GFTT", "AKAZE", "SIFT"])
    places, rows = {}, []
    for name, times in least.items():
        finder = ours.get(name)
        peer = Peer(finder.detect, finder.detectAndCompute) if finder else known[name.split(",")[0]]
        mean = float(np.mean([score_pairs(of_set, peer, "B", 1000)["B"] for of_set in pairs]))
        orbs = (least["ORB"], least["ORB, FAST 5"])
        shares = [f"{ms / other:.2f}" for orb in orbs for ms, other in zip(times, orb, strict=True)]
        rows.append((name, *(f"{ms:.1f}" for ms in times), *shares, f"{mean:.3f}"))
        places[name] = (times[0], mean)
    return places, rows
