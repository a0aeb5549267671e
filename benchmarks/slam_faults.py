"""SLAM on the loop of the house with spoiled images: views gone, darkness, people, fast motion, odd light."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np
from _common import data_folder, show
from numpy.typing import NDArray
from slam_places import House

from facetcam.evaluation.trajectory import ate, scale_error
from facetcam.io.odometry import read_odometry
from facetcam.slam import Slam, State, Status

Array = NDArray[np.float64]
Image = NDArray[np.uint8]
Spoil = Callable[[int, Image], Image]

COLUMNS = ("fault", "wheels", "tracked", "else said", "gap s", "back s", "ATE mm", "scaled", "scale", "off")
SECOND = 10  # frames
SEEDS = 5
FIRST_DARK = 40  # frame from which the lights may fail
LATE = 100  # frame in which a person enters a view that was seen before
WALK = 45  # frames in which a person passes a view


@dataclass(frozen=True)
class Fault:
    """What is done to the film; in the frames `dark` nothing can be seen."""

    name: str
    spoil: Spoil
    dark: range = range(0)
    first: int = 0
    step: int = 1


@dataclass(frozen=True)
class Film:
    """Grey frames of the loop, with its truth, wheels and the views that its pixels belong to."""

    house: House
    images: list[Image]
    labels: NDArray[np.int8]

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.house.rig.view_names)


def blanked(film: Film, views: tuple[int, ...], how: str) -> Fault:
    """Views that are black, white, or stand still from the first frame on."""
    gone = np.isin(film.labels, views)
    still = {"black": np.zeros_like(film.images[0]), "white": np.full_like(film.images[0], 255)}
    shown = still.get(how, film.images[0])
    name = " and ".join(film.names[v] for v in views)
    return Fault(f"{name} {how}", lambda k, image: np.where(gone, shown, image))


def darkness(seed: int, n_frames: int) -> Fault:
    """One second of black frames."""
    first = int(np.random.default_rng(seed).integers(FIRST_DARK, n_frames - 3 * SECOND))
    dark = range(first, first + SECOND)
    return Fault(
        f"dark from frame {first}", lambda k, image: np.zeros_like(image) if k in dark else image, dark
    )


def covered(first: int) -> Fault:
    """Two seconds of a hand on the lens: dim and noisy."""
    dark, rng = range(first, first + 2 * SECOND), np.random.default_rng(0)

    def spoil(k: int, image: Image) -> Image:
        return rng.integers(0, 12, image.shape, dtype=np.uint8) if k in dark else image

    return Fault(f"lens covered from frame {first}", spoil, dark)


@dataclass(frozen=True)
class Intruder:
    """Who comes before a view, in loud clothes or plain ones, and walks to and fro; a sticker stays."""

    share: float  # of the view's width
    enter: int = 0  # frame
    clothes: str = "loud"  # or plain
    walks: bool = True
    seed: int = 0

    def name(self, view: str) -> str:
        who = ("person" if self.walks else "sticker") + (
            " in plain clothes" if self.clothes == "plain" else ""
        )
        since = f" from frame {self.enter}" if self.enter else ""
        return f"{who} before {100 * self.share:.0f} % of {view}{since}"


def intrusion(film: Film, view: int, who: Intruder) -> Fault:
    """Someone who walks to and fro through one view, or a sticker on it, and hides a share of its width."""
    _, columns = np.nonzero(film.labels == view)
    left, right = int(columns.min()), int(columns.max())
    width = int(who.share * (right - left))
    rng = np.random.default_rng(who.seed)
    threads = (150, 200) if who.clothes == "loud" else (12, 16)
    clothes = cv2.resize(rng.integers(0, 256, threads, dtype=np.uint8), film.images[0].shape[::-1])

    def spoil(k: int, image: Image) -> Image:
        if k < who.enter:
            return image
        way = abs(((k - who.enter) / WALK) % 2.0 - 1.0) if who.walks else 0.5
        x = int(left + way * (right - left - width))
        hidden = film.labels == view
        hidden[:, :x], hidden[:, x + width :] = False, False
        return np.where(hidden, np.roll(clothes, x, axis=1), image)

    return Fault(who.name(film.names[view]), spoil)


def rolling_light(film: Film) -> Fault:
    """Lamps that flicker faster than the shutter rolls: bands of +-30 % that wander over the frame."""
    rows = np.linspace(0.0, 1.0, film.images[0].shape[0])[:, None]

    def spoil(k: int, image: Image) -> Image:
        gain = 1.0 + 0.3 * np.sin(2.0 * np.pi * (3.0 * rows + 0.37 * k))
        return np.clip(gain * image, 0, 255).astype(np.uint8)

    return Fault("bands of light", spoil)


def untouched(k: int, image: Image) -> Image:
    return image


def faults(film: Film) -> Iterator[Fault]:
    yield Fault("none", untouched)
    views, n = range(len(film.names)), len(film.images)
    for how in ("black", "white", "frozen"):
        yield from (blanked(film, (v,), how) for v in views)
    yield from (blanked(film, pair, "black") for pair in combinations(views, 2))
    yield from (darkness(seed, n) for seed in range(SEEDS))
    yield covered(120)
    yield from (intrusion(film, v, Intruder(share)) for v, share in zip(views, (0.3, 0.4, 0.5, 0.6)))
    yield from (intrusion(film, v, Intruder(share, LATE)) for v, share in zip(views, (0.8, 0.7, 0.6, 0.8)))
    yield rolling_light(film)
    yield from (Fault(f"from frame {k}", untouched, first=k) for k in (100, 200))
    yield Fault("every 4th frame", untouched, step=4)
    yield Fault("every 5th frame", untouched, step=5)


@dataclass(frozen=True)
class Result:
    """States of the frames shown, how many maps are left in the end, and of the final poses in the longest
    one the errors (m), without and with a fitted scale.
    """

    frames: range
    states: list[State]
    maps: int
    error: float
    scaled_error: float
    scale_error: float
    scale: str


def run(film: Film, fault: Fault, with_wheels: bool) -> Result:
    times, poses = film.house.truth("loop")
    wheels = read_odometry(film.house.folder / "loop_odometry.csv")
    slam, states = Slam(film.house.rig), []
    frames = range(fault.first, len(film.images), fault.step)
    for k in frames:
        image = fault.spoil(k, film.images[k])
        states.append(slam.track(image, times[k], wheels.at(times[k]) if with_wheels else None))
    slam.finish()
    known = f" ± {100 * slam.scale_sigma:.2g} %" if np.isfinite(slam.scale_sigma) else ""
    scale = ("METRIC" if slam.metric else "NOT METRIC") + known
    maps = 1 + len(slam.trajectories_apart())
    tracked, own = slam.trajectory()
    if len(own) < 3:
        return Result(frames, states, maps, *(3 * [float("nan")]), scale)
    own, true = own[:, :3, 3], poses[np.searchsorted(times, tracked - 1e-6)][:, :3, 3]
    error, scaled = (ate(own, true, with_scale=w).rmse for w in (False, True))
    return Result(frames, states, maps, error, scaled, scale_error(own, true), scale)


def row(film: Film, fault: Fault, with_wheels: bool) -> list[str]:
    result = run(film, fault, with_wheels)
    found = np.array([s.status is Status.TRACKING for s in result.states])
    seen = np.array([k not in fault.dark for k in result.frames])
    started = int(np.argmax(found))
    said = sorted({s.status.value for s, f in zip(result.states[started:], found[started:]) if not f})
    after = found[fault.dark.stop :] if fault.dark else found[:0]
    back = "" if not fault.dark else f"{(int(np.argmax(after)) + 1) / SECOND:.1f}" if after.any() else "never"
    return [
        fault.name,
        "yes" if with_wheels else "no",
        f"{100 * found[seen].mean():.1f} %" + (f" in {result.maps} maps" if result.maps > 1 else ""),
        ", ".join(said).replace("_", " "),
        f"{fault.step * longest_run(~found[started:] & seen[started:]) / SECOND:.1f}",
        back,
        f"{1e3 * result.error:.1f}",
        f"{1e3 * result.scaled_error:.1f}",
        result.scale,
        f"{100 * result.scale_error:+.2f} %",
    ]


def longest_run(flags: NDArray[np.bool_]) -> int:
    """Length of the longest run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]])))
    return int((edges[1::2] - edges[::2]).max(initial=0))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="run only faults whose name holds this")
    parser.add_argument("--wheels", choices=("yes", "no", "both"), default="both")
    options = parser.parse_args()
    only: str = options.only
    house = House(data_folder() / "house")
    film = Film(house, [cv2.cvtColor(i, cv2.COLOR_BGR2GRAY) for i in house.film("loop")], house.rig.labels())
    chosen = [fault for fault in faults(film) if only in fault.name]
    wheels = {"yes": (True,), "no": (False,), "both": (True, False)}[options.wheels]
    rows = []
    for fault in chosen:
        for with_wheels in wheels:
            rows.append(row(film, fault, with_wheels))
            print(*rows[-1], sep=" | ", file=sys.stderr, flush=True)
    show("loop.mp4 spoiled", COLUMNS, rows)


if __name__ == "__main__":
    main()
