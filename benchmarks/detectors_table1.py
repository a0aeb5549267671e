"""Table 1 of the paper again: threshold, points and time of four detectors on 50 indoor images.

25 photographs of a kitchen and 25 frames of the two mirror films, lamps on and off, all scaled to 640x480.
"""

from __future__ import annotations

import time

import cv2
import numpy as np
from _common import data_folder, show

from facetcam.features import SIICF, DoG, HarrisLaplace, LoG
from facetcam.features.images import Image

SIZE = (640, 480)
PAPER = {"LoG": (207, 310), "DoG": (1520, 400), "Harris-Laplacian": (153, 1600), "SIICF": (353, 250)}


def images() -> list[Image]:
    """The 50 images, grey."""
    photographs = sorted((data_folder() / "kitchen").glob("*.jpg"))
    chosen = [
        cv2.imread(str(photographs[i]), 0) for i in np.linspace(0, len(photographs) - 1, 25).astype(int)
    ]
    for film, count in (("loop", 13), ("lights", 12)):
        video = cv2.VideoCapture(str(data_folder() / "house" / f"{film}.mp4"))
        total = int(video.get(cv2.CAP_PROP_FRAME_COUNT))
        for index in np.linspace(0, total - 1, count).astype(int):
            video.set(cv2.CAP_PROP_POS_FRAMES, int(index))
            chosen.append(cv2.cvtColor(video.read()[1], cv2.COLOR_BGR2GRAY))
    return [np.asarray(cv2.resize(image, SIZE, interpolation=cv2.INTER_AREA)) for image in chosen]


def main() -> None:
    cv2.setNumThreads(1)
    detectors = {
        "LoG": ("10", LoG.create(max_features=None)),
        "DoG": ("default", DoG.create(max_features=None)),
        "Harris-Laplacian": ("default", HarrisLaplace.create(max_features=None)),
        "SIICF": ("500", SIICF.create(mode="paper", max_features=None)),
        "SIICF robust": ("0.02", SIICF.create(max_features=None)),
    }
    found = images()
    rows = []
    for name, (threshold, detector) in detectors.items():
        start = time.perf_counter()
        points = [len(detector.detect(image)) for image in found]
        milliseconds = 1000 * (time.perf_counter() - start) / len(found)
        then = PAPER.get(name, ("", ""))
        rows.append((name, threshold, f"{np.mean(points):.0f}", f"{milliseconds:.1f}", *map(str, then)))
    columns = ("detector", "threshold", "points", "ms", "points in the paper", "ms in the paper")
    show(f"Table 1 on {len(found)} indoor images", columns, rows)


if __name__ == "__main__":
    main()
