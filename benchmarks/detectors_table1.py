"""Table 1 of the paper again: threshold, points and time of four detectors on 50 indoor images.

25 photographs of a kitchen and 25 frames of the two mirror films, lamps on and off, all scaled to 640x480.
"""

from __future__ import annotations

import time

import cv2
import numpy as np
from _common import data_folder, show

from facetcam.features import SIICF, DoG, HarrisLaplace, LoG
from facetcam.features.detector import Detector
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


def measured(detector: Detector, image: Image) -> tuple[int, float]:
    """Points in an image, and the least processor time of three calls in milliseconds."""
    times = []
    for _ in range(3):
        start = time.process_time()
        points = detector.detect(image)
        times.append(time.process_time() - start)
    return len(points), 1000 * min(times)


def main() -> None:
    cv2.setNumThreads(1)
    detectors = {
        "LoG": ("10", LoG.create(max_features=None)),
        "DoG": ("default", DoG.create(max_features=None)),
        "Harris-Laplacian": ("default", HarrisLaplace.create(max_features=None)),
        "SIICF": ("500", SIICF.create(mode="paper", max_features=None, threads=1)),
        "SIICF robust": ("0.019", SIICF.create(max_features=None, threads=1)),
    }
    found = [[measured(d, image) for _, d in detectors.values()] for image in images()]
    points, times = np.mean(found, axis=0).T
    ours = list(detectors).index("SIICF")
    rows = []
    for i, (name, (threshold, _)) in enumerate(detectors.items()):
        row = [name, threshold, f"{points[i]:.0f}", f"{times[i]:.1f}"]
        paper = zip(PAPER.get(name, ()), PAPER["SIICF"], strict=False)
        then = [f"{theirs / own:.2f}" for theirs, own in paper] or ["", ""]
        row += [f"{points[i] / points[ours]:.2f}", then[0], f"{times[i] / times[ours]:.3f}", then[1]]
        rows.append(row)
    columns = (
        "detector",
        "threshold",
        "points",
        "ms",
        "points / SIICF",
        "in paper",
        "ms / SIICF",
        "in paper",
    )
    show(f"Table 1 on {len(found)} indoor images", columns, rows)


if __name__ == "__main__":
    main()
