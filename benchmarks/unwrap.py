"""Four 640x480 views from a 1600x1200 frame, against four float-map cv2.remap calls in the same run.

Once with all that the views see (a third of each picture, the rest is black), once with full pictures.

python benchmarks/unwrap.py [--rounds 200]
"""

from __future__ import annotations

import argparse
import functools
import itertools
import math
import statistics
import time
from collections.abc import Callable

import cv2
import numpy as np

import facetcam
from facetcam.rig import Rig
from facetcam.unwrapping import Unwrapper, unwrap


def float_maps(unwrapper: Unwrapper) -> list[tuple[np.ndarray, np.ndarray]]:
    """The same views as ready float maps for cv2.remap, holes outside the frame."""
    rig = unwrapper.rig
    maps = []
    for name, view in unwrapper.views.items():
        points = view.T_rig_view[:3, 3] + view.rays().reshape(-1, 3)
        pixels, _ = rig.project(name, points)
        pixels[unwrapper.mask(name).ravel() == 0] = -10.0
        x, y = pixels.T.reshape(2, view.camera.height, view.camera.width).astype(np.float32)
        maps.append((x, y))
    return maps


def remap_all(frame: np.ndarray, maps: list[tuple[np.ndarray, np.ndarray]]) -> list[np.ndarray]:
    return [cv2.remap(frame, x, y, cv2.INTER_LINEAR) for x, y in maps]


def alternate(tasks: dict[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Median milliseconds of each task, taken in turns so that a busy machine disturbs all alike."""
    times: dict[str, list[float]] = {name: [] for name in tasks}
    for _ in range(rounds):
        for name, task in tasks.items():
            begin = time.perf_counter()
            task()
            times[name].append(1e3 * (time.perf_counter() - begin))
    return {name: statistics.median(values) for name, values in times.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=200)
    rounds = parser.parse_args().rounds
    rig = Rig.load("preset:ryu")
    unwrappers = {
        "whole view": unwrap(rig, size=(640, 480)),
        "20 degrees": unwrap(rig, (640, 480), math.radians(20)),
    }
    noise = np.random.default_rng(0).integers(0, 256, (1200, 1600, 3), dtype=np.uint8)
    colour = cv2.GaussianBlur(noise, (0, 0), 2)
    frames = {"grey": np.ascontiguousarray(colour[:, :, 0]), "colour": colour}
    everyone = cv2.getNumThreads()
    print(f"facetcam {facetcam.__version__}, OpenCV {cv2.__version__}, medians of {rounds} rounds, in ms")
    print(
        f"{'pictures':12}{'frame':8}{'filled':>8}{'threads':>8}{'facetcam':>10}{'cv2.remap':>11}{'ratio':>7}"
    )
    for (title, unwrapper), threads in itertools.product(unwrappers.items(), sorted({1, everyone})):
        cv2.setNumThreads(threads)
        maps = float_maps(unwrapper)
        filled = np.mean([(unwrapper.mask(name) > 0).mean() for name in unwrapper.views])
        for kind, frame in frames.items():
            tasks = {
                "ours": functools.partial(unwrapper, frame),
                "theirs": functools.partial(remap_all, frame, maps),
            }
            median = alternate(tasks, rounds)
            ratio = median["ours"] / median["theirs"]
            print(
                f"{title:12}{kind:8}{filled:8.0%}{threads:8d}{median['ours']:10.2f}{median['theirs']:11.2f}{ratio:7.2f}"
            )


if __name__ == "__main__":
    main()
