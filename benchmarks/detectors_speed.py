"""Time of detectors on one 1600x1200 frame, the gain of a second thread, and the memory of SIICF."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from _common import data_folder, show

from facetcam.features import SIICF
from facetcam.features.images import Image

ROUNDS = 9
TURNS = 300  # of one thread and two


def frame() -> Image:
    """First frame of the mirror film, 1600x1200 grey."""
    ok, image = cv2.VideoCapture(str(data_folder() / "house" / "loop.mp4")).read()
    assert ok, "house/loop.mp4 has no frame"
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))


def textured() -> Image:
    """A wall full of detail, 1600x1200."""
    wall = cv2.imread(str(data_folder() / "oxford" / "graf" / "img1.png"), cv2.IMREAD_GRAYSCALE)
    return np.asarray(cv2.resize(wall, (1600, 1200)))


def extra_memory(image: Image) -> float:
    """Growth of the peak memory of this process by a first detection, in sizes of the image."""
    Path("/proc/self/clear_refs").write_text("5")  # forget the peak so far
    before = status("VmRSS")
    SIICF.create(scales=4, threads=1).detect(image)
    return (status("VmHWM") - before) / image.nbytes


def status(key: str) -> int:
    """Bytes under a key of /proc/self/status."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024 * int(next(line.split()[1] for line in lines if line.startswith(key)))


def medians(detectors: dict[str, Callable[[Image], object]], image: Image) -> dict[str, float]:
    """Milliseconds by name: medians of rounds in which every detector has its turn."""
    seconds: dict[str, list[float]] = {name: [] for name in detectors}
    for _ in range(ROUNDS):
        for name, detect in detectors.items():
            start = time.perf_counter()
            detect(image)
            seconds[name].append(time.perf_counter() - start)
    return {name: 1000 * float(np.median(values)) for name, values in seconds.items()}


def second_thread(image: Image) -> list[tuple[str, ...]]:
    """Gain of a second thread; OpenCV's blur says what the second core could give at that moment.

    Least times of many turns: on a shared machine a second core is seldom free for a whole call.
    """

    def blur(threads: int) -> Callable[[], object]:
        def blurred() -> None:
            cv2.setNumThreads(threads)
            cv2.GaussianBlur(image, (0, 0), 9.0)

        return blurred

    def corners(threads: int) -> Callable[[], object]:
        detector = SIICF.create(scales=4, threads=threads)
        return lambda: detector.detect(image)

    rows = []
    for name, job in (("SIICF, 4 scales", corners), ("Gaussian blur of OpenCV", blur)):
        jobs = [job(1), job(2)]
        least = [np.inf, np.inf]
        for _ in range(TURNS):
            for k, work in enumerate(jobs):
                start = time.perf_counter()
                work()
                least[k] = min(least[k], 1000 * (time.perf_counter() - start))
        rows.append((name, f"{least[0]:.1f}", f"{least[1]:.1f}", f"{least[0] / least[1]:.2f}"))
    cv2.setNumThreads(1)
    return rows


def main() -> None:
    images = {"film": frame(), "wall": textured()}
    print(f"peak extra memory of SIICF: {extra_memory(images['film']):.1f} x the image")
    extra = cv2.xfeatures2d
    detectors = {
        "SIICF, 4 scales": SIICF.create(scales=4, threads=1).detect,
        "SIICF, 3 scales": SIICF.create(threads=1).detect,
        "SIICF paper": SIICF.create(mode="paper").detect,
        "ORB": cv2.ORB.create().detect,
        "ORB, FAST 5": cv2.ORB.create(1000, fastThreshold=5).detect,  # as in `evaluate detectors`
        "GFTT": cv2.GFTTDetector.create().detect,
        "AKAZE": extra.AKAZE.create().detect if hasattr(extra, "AKAZE") else cv2.AKAZE.create().detect,
        "SIFT": cv2.SIFT.create().detect,
        "Harris-Laplace": extra.HarrisLaplaceFeatureDetector.create().detect,
    }
    cv2.setNumThreads(1)
    for title, image in images.items():
        times = medians(detectors, image)
        own = times["SIICF, 4 scales"]
        rows = [(name, f"{ms:.1f}", f"{ms / own:.2f}") for name, ms in times.items()]
        show(f"{title}, 1600x1200, one thread", ("detector", "ms", "/ SIICF, 4 scales"), rows)
        columns = ("least of many", "1 thread, ms", "2 threads, ms", "gain")
        show(f"{title}, a second thread", columns, second_thread(image))


if __name__ == "__main__":
    main()
