"""`Slam` with other front ends on the same films: SIICF against ORB, GFTT and SIFT, also in failing light.

Everything behind the corners is the same: as many of them, spread by the same cells, turned upright by the
rig, described by 256 bits. GFTT has no descriptor of its own and takes the one of SIICF; SIFT's vectors are
made bits by their median and quartile (W. Zhou et al., "Scalable feature matching by dual cascaded scalar
quantization for image retrieval", 2016). *front* and *CPU* are milliseconds of processor time a frame, of the
front end alone and of all tracking and mapping.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any

import cv2
import numpy as np
from _common import data_folder, show
from numpy.typing import NDArray

from facetcam.errors import FacetcamError
from facetcam.evaluation.trajectory import evaluate
from facetcam.features import Keypoints, describe
from facetcam.pipelines.inputs import SlamInputs, read_slam_inputs
from facetcam.slam import Slam, SlamConfig, Status
from facetcam.slam.camera.corner_finder import Features, FrontEnd, SiicfFeatures
from facetcam.slam.parts import Parts

Image = NDArray[np.uint8]
Described = tuple[Keypoints, NDArray[np.uint8]]

COLUMNS = ("film", "corners", "tracked", "ATE cm", "scaled", "off", "scale", "front", "CPU")
OFFERED = 8  # times as many corners as are wanted, of which cells take the best
PER_CELL = 9


class OpenCvFeatures:
    """A detector of OpenCV, with the descriptor of another or its own."""

    def __init__(self, detector: cv2.Feature2D, wanted: int, cell: int) -> None:
        self._detector = detector
        self._wanted = wanted
        self._cell = cell

    def detect(self, image: Image, mask: Image, black: float) -> Keypoints:
        """The strongest corners of every cell, then the strongest of all."""
        found = self._detector.detect(image, mask)
        rows = [(*k.pt, k.size, k.angle, k.response, k.octave) for k in found]  # SIFT packs its octave
        keypoints = Keypoints.from_rows(np.array(rows, np.float32).reshape(-1, 6))
        keypoints = replace(keypoints, level=np.array([k.octave for k in found], np.int32))
        keypoints = keypoints[np.argsort(-keypoints.response, kind="stable")]
        cells = (keypoints.xy // self._cell).astype(np.int64) @ [1 << 16, 1]
        order = np.argsort(cells, kind="stable")
        rank = np.empty(len(order), np.int64)
        rank[order] = np.arange(len(order)) - np.searchsorted(cells[order], cells[order])
        return keypoints[np.flatnonzero(rank < PER_CELL)[: self._wanted]]

    def describe(self, image: Image, keypoints: Keypoints, flipped: bool) -> Described:
        """TEBLID, as SIICF has it."""
        sized = replace(keypoints, size=np.full(len(keypoints), SIICF_SIZE, np.float32))
        kept, bits = describe(image, sized, flipped, "binary")
        return kept, bits


SIICF_SIZE = 12.0


class OwnDescriptor(OpenCvFeatures):
    """A detector with its own descriptor."""

    def describe(self, image: Image, keypoints: Keypoints, flipped: bool) -> Described:
        points = keypoints.to_cv2()
        for index, point in enumerate(points):
            point.class_id = index
            if flipped:
                point.pt = (image.shape[1] - 1 - point.pt[0], point.pt[1])
                point.angle = (180.0 - point.angle) % 360.0
        seen = np.ascontiguousarray(image[:, ::-1]) if flipped else image
        kept, vectors = self._detector.compute(seen, points)
        rows = np.array([point.class_id for point in kept], np.intp)
        return keypoints[rows], self._bits(vectors) if len(rows) else np.empty((0, 32), np.uint8)

    def _bits(self, vectors: NDArray[Any]) -> NDArray[np.uint8]:
        return np.asarray(vectors, np.uint8)


class BinarySift(OwnDescriptor):
    """SIFT, two bits a number: above the median, above the upper quartile of its vector."""

    def _bits(self, vectors: NDArray[Any]) -> NDArray[np.uint8]:
        middle, upper = np.quantile(vectors, (0.5, 0.75), axis=1, keepdims=True)
        return np.packbits(np.concatenate([vectors > middle, vectors > upper], axis=1), axis=1)


def orb(wanted: int, cell: int) -> OpenCvFeatures:
    return OwnDescriptor(cv2.ORB.create(OFFERED * wanted, fastThreshold=7), wanted, cell)


def gftt(wanted: int, cell: int) -> OpenCvFeatures:
    return OpenCvFeatures(cv2.GFTTDetector.create(OFFERED * wanted, 0.001, 5), wanted, cell)


def sift(wanted: int, cell: int) -> OpenCvFeatures:
    return BinarySift(cv2.SIFT.create(OFFERED * wanted, contrastThreshold=0.01), wanted, cell)


FRONT_ENDS: dict[str, FrontEnd] = {"SIICF": SiicfFeatures, "ORB": orb, "GFTT": gftt, "SIFT": sift}


@dataclass(frozen=True, slots=True)
class Film:
    """A film with truth, and how its light is spoiled."""

    name: str
    stem: str
    light: str = ""
    wheels: bool = False


FILMS = (
    Film("loop", "loop"),
    Film("loop + odometry", "loop", wheels=True),
    Film("lights", "lights"),
    Film("lights + odometry", "lights", wheels=True),
    Film("dimming", "lights", "dimming"),
    Film("dimming + odometry", "lights", "dimming", wheels=True),
    Film("gain and gamma", "lights", "gamma"),
    Film("gain and gamma + odometry", "lights", "gamma", wheels=True),
)


def spoiled(grey: Image, k: int, light: str, rng: np.random.Generator) -> Image:
    """Frame k as a camera shows it whose light fails: values rounded again, with fresh noise of one level.

    `dimming` falls to a fortieth within each 50 frames and comes back at once; `gamma` swings gain between
    0.3 and 1.7 and gamma between 0.5 and 2, at 0.7 and 1.1 radians in ten frames, and clips.
    """
    if not light:
        return grey
    value = grey.astype(np.float32) / 255.0
    if light == "dimming":
        value *= 0.025 ** ((k % 50) / 49.0)
    else:
        value = (1.0 + 0.7 * np.sin(0.07 * k)) * value ** (2.0 ** np.sin(0.11 * k))
    return np.asarray(np.clip(255.0 * value + rng.normal(0.0, 1.0, grey.shape) + 0.5, 0, 255), np.uint8)


class SlamWith(Slam):
    """`Slam` with another front end, whose time is taken."""

    def __init__(self, front_end: FrontEnd, inputs: SlamInputs) -> None:
        self._front_end = front_end
        super().__init__(inputs.rig, SlamConfig())

    def _assemble(self) -> Parts:
        return Parts.assemble(self.rig, self.config, self._timed_front_end)

    def _timed_front_end(self, wanted: int, cell: int) -> Timed:
        self.features = Timed(self._front_end(wanted, cell))
        return self.features

    def milliseconds(self) -> float:
        """Processor time of the front end a frame that it looked at."""
        frames = self.features.detections / len(self.rig.view_names)
        return 1e3 * self.features.seconds / max(frames, 1.0)


class Timed:
    """A front end with the processor time of all its work; it detects in each view by itself."""

    def __init__(self, features: Features) -> None:
        self._features = features
        self.seconds = 0.0
        self.detections = 0

    def detect(self, image: Image, mask: Image, black: float) -> Keypoints:
        start = time.process_time()
        found = self._features.detect(image, mask, black)
        self.seconds += time.process_time() - start
        self.detections += 1
        return found

    def describe(self, image: Image, keypoints: Keypoints, flipped: bool) -> Described:
        start = time.process_time()
        described = self._features.describe(image, keypoints, flipped)
        self.seconds += time.process_time() - start
        return described


def greys(inputs: SlamInputs, light: str, frames: int) -> Iterator[tuple[float, Image]]:
    """Times and grey frames, spoiled alike for every front end."""
    rng = np.random.default_rng(0)
    for k, frame in enumerate(islice(inputs.source, frames)):
        yield frame.timestamp, spoiled(cv2.cvtColor(frame.image, cv2.COLOR_BGR2GRAY), k, light, rng)


def row(film: Film, name: str, frames: int) -> list[str]:
    """One line of the table."""
    house = data_folder() / "house"
    wheels = house / f"{film.stem}_odometry.csv" if film.wheels else None
    truth = house / f"{film.stem}.tum"
    source = house / f"{film.stem}.mp4"
    inputs = read_slam_inputs(source, house / "rig_true.yaml", wheels, truth, None, None, None)
    slam = SlamWith(FRONT_ENDS[name], inputs)
    tracked, count, seconds = 0, 0, 0.0
    with inputs.source:
        for time_, grey in greys(inputs, film.light, frames):
            start = time.process_time()
            state = slam.track(grey, time_, inputs.odometry_at(time_))
            seconds += time.process_time() - start
            tracked += state.status is Status.TRACKING
            count += 1
    slam.finish()
    cells = [film.name, name, f"{100 * tracked / count:.1f} %", *errors(slam, inputs)]
    return [*cells, f"{slam.milliseconds():.0f}", f"{1e3 * seconds / count:.0f}"]


def errors(slam: Slam, inputs: SlamInputs) -> list[str]:
    """Errors of the final poses, and what the run says of its scale."""
    assert inputs.truth is not None
    sigma = f" ± {100 * slam.scale_sigma:.2g} %" if np.isfinite(slam.scale_sigma) else ""
    says = ("METRIC" if slam.metric else "NOT METRIC") + sigma
    try:
        found = evaluate(slam.trajectory(), inputs.truth, 0.02)
    except FacetcamError:
        return ["no path", "", "", says]
    centimetres = [f"{100 * e.rmse:.1f}" for e in (found.ate, found.ate_scaled)]
    return [*centimetres, f"{100 * found.scale_error:+.2f} %", says]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--film", default="", help="run only films whose name holds this")
    parser.add_argument("--front-end", default="", help="run only front ends whose name holds this")
    parser.add_argument("--frames", type=int, default=1000, help="of each film, at most")
    args = parser.parse_args()
    cv2.setNumThreads(2)
    names = [name for name in FRONT_ENDS if args.front_end in name]
    films = [film for film in FILMS if args.film in film.name]
    rows = [row(film, name, args.frames) for film in films for name in names]
    show("the same tracker behind other front ends", COLUMNS, rows)


if __name__ == "__main__":
    main()
