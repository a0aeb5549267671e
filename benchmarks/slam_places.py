"""Saved maps: another film localised in one, and starts anywhere in it, turned."""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np
from _common import data_folder, show
from numpy.typing import NDArray

from facetcam.evaluation.trajectory import Alignment, align
from facetcam.geometry import se3
from facetcam.io.odometry import read_odometry
from facetcam.io.sources import open_source
from facetcam.io.trajectories import read_tum
from facetcam.rig import Rig
from facetcam.slam import Slam, State, Status

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

STARTS = 10
TRIES = 10  # frames in which a start must succeed
SOURCES = (0, -15, 15, -30, 30, -45, 45)  # frames that lend their pixels to a turned one
HIDDEN = 0.02  # relative depth beyond which a surface hides a point


class House:
    """Films and truth of the house, and its surfaces."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.rig = Rig.load(folder / "rig_true.yaml")

    def film(self, name: str) -> list[Image]:
        """All frames."""
        with open_source(self.folder / f"{name}.mp4", None) as source:
            return [np.asarray(frame.image) for frame in source]

    def truth(self, name: str) -> tuple[Array, Array]:
        """Times and poses."""
        return read_tum(self.folder / f"{name}.tum")

    def map(self, images: list[Image], path: Path) -> Alignment:
        """Map the loop with wheels; returns the motion from the map's frame to the true world."""
        slam, (times, poses) = Slam(self.rig), self.truth("loop")
        wheels = read_odometry(self.folder / "loop_odometry.csv")
        for image, t in zip(images, times):
            slam.track(image, t, wheels.at(t))
        slam.finish()
        slam.save_map(path)
        tracked, own = slam.trajectory()
        true = poses[np.searchsorted(times, tracked - 1e-6)]
        print(f"map: {slam.loops} loop closed, {path.stat().st_size / 1e6:.1f} MB")
        return align(own[:, :3, 3], true[:, :3, 3], with_scale=False)


class Turner:
    """Frames as the rig would take them turned on the spot.

    Each pixel's ray is followed to the surface of the house, and takes the colour that the film has of that
    point: in the frame of the same time where the point is seen there, else in frames before and after. So
    every point comes back in another mirror, at the pixels where that mirror shows it.
    """

    def __init__(self, house: House, images: list[Image]) -> None:
        import trimesh

        self._rig, self._images = house.rig, images
        self._poses = house.truth("loop")[1]
        self._mesh = trimesh.load(house.folder / "small_house.glb").to_geometry()

    def __call__(self, k: int, angle: float) -> tuple[Image, Array]:
        """Frame k turned by an angle in radians, and its true pose."""
        T = self._poses[k] @ se3.exp([0, 0, angle, 0, 0, 0])
        labels = self._rig.labels()
        image = np.zeros_like(self._images[0])
        for v, name in enumerate(self._rig.view_names):
            rows, columns = np.nonzero(labels == v)
            origins, rays = self._rig.ray(name, np.column_stack([columns, rows]))
            points = self._hit(se3.transform(T, origins), rays @ T[:3, :3].T)
            image[rows, columns] = self._colours(points, k)
        return image, T

    def _colours(self, points: Array, k: int) -> Image:
        """Colours (N, 3) of surface points, black where no frame sees them."""
        colours = np.zeros((len(points), 3), np.uint8)
        missing = np.isfinite(points[:, 0])
        for j in (k + step for step in SOURCES):
            if not 0 <= j < len(self._images):
                continue
            for name in self._rig.view_names:
                rows = np.flatnonzero(missing)
                rig_points = se3.transform(se3.inverse(self._poses[j]), points[rows])
                pixels, visible = self._rig.project(name, rig_points)
                rows, pixels = rows[visible], pixels[visible]
                if j != k:
                    clear = self._in_sight(points[rows], self._eye(j, name))
                    rows, pixels = rows[clear], pixels[clear]
                if len(rows):
                    colours[rows] = sampled(self._images[j], pixels)
                    missing[rows] = False
        return colours

    def _eye(self, j: int, name: str) -> Array:
        return np.asarray((self._poses[j] @ self._rig.T_rig_view(name))[:3, 3])

    def _in_sight(self, points: Array, eye: Array) -> NDArray[np.bool_]:
        away = points - eye
        distance = np.linalg.norm(away, axis=1)
        hits = self._hit(np.broadcast_to(eye, points.shape), away / distance[:, None])
        return np.asarray(np.linalg.norm(hits - eye, axis=1) > (1.0 - HIDDEN) * distance)

    def _hit(self, origins: Array, rays: Array) -> Array:
        """Where rays (N, 3) meet the house; NaN where they do not."""
        places, ray, _ = self._mesh.ray.intersects_location(origins, rays, multiple_hits=False)
        points = np.full(origins.shape, np.nan)
        points[ray] = places
        return points


def sampled(image: Image, pixels: Array) -> Image:
    """Colours (N, 3) at pixels (N, 2), between four neighbours; OpenCV takes no longer rows than these."""
    parts = [
        cv2.remap(image, *np.ascontiguousarray(part.T[:, :, None], np.float32), cv2.INTER_LINEAR)[:, 0]
        for part in np.array_split(pixels, len(pixels) // 30000 + 1)
    ]
    return np.concatenate(parts)


def error(state: State, truth: Array, alignment: Alignment) -> float:
    """Metres between a state and the true pose; NaN where it has none."""
    if state.T_world_rig is None:
        return float("nan")
    return float(np.linalg.norm(alignment.apply(state.T_world_rig[None, :3, 3])[0] - truth[:3, 3]))


def localise(house: House, path: Path, alignment: Alignment) -> None:
    slam, (times, poses) = Slam(house.rig), house.truth("lights")
    slam.load_map(path, localise_only=True)
    states = [slam.track(image, t) for image, t in zip(house.film("lights"), times)]
    found = [state.status is Status.TRACKING for state in states]
    errors = [error(state, T, alignment) for state, T, f in zip(states, poses, found) if f]
    row = [f"{100 * np.mean(found):.1f} %", f"{1e3 * np.median(errors):.1f}", f"{1e3 * max(errors):.1f}"]
    show(
        "lights.mp4 in the map of loop.mp4", ("film", "localised", "median mm", "max mm"), [["lights", *row]]
    )


def turned_starts(house: House, images: list[Image], path: Path, alignment: Alignment) -> None:
    turner, rng, rows = Turner(house, images), np.random.default_rng(0), []
    starts = np.sort(rng.choice(len(images) - TRIES, STARTS, replace=False))
    for degrees in (90, 180):
        runs = [start(house, turner, int(k), np.radians(degrees), path, alignment) for k in starts]
        good = [r for r in runs if np.isfinite(r[1])]
        needed = [r[0] for r in good]
        rows.append(
            [
                f"turned by {degrees}",
                f"{len(good)} of {len(runs)}",
                f"{np.median(needed):.0f}, {max(needed)}",
                f"{1e3 * np.median([r[1] for r in good]):.1f}, {1e3 * max(r[1] for r in good):.1f}",
                f"{1e3 * np.median([r[2] for r in runs]):.0f}, {1e3 * max(r[2] for r in runs):.0f}",
            ]
        )
    columns = ("starts", "found", "frames", "error mm", "ms a frame")
    show("starts in a saved map (median, largest)", columns, rows)


def start(
    house: House, turner: Turner, k: int, angle: float, path: Path, alignment: Alignment
) -> tuple[int, float, float]:
    """Frames needed, error (m, NaN where not found) and longest time of a frame (s) of one start."""
    slam, slowest = Slam(house.rig), 0.0
    slam.load_map(path, localise_only=True)
    for tried in range(TRIES):
        image, T = turner(k + tried, angle)
        begin = time.perf_counter()
        state = slam.track(image, tried / 10)
        slowest = max(slowest, time.perf_counter() - begin)
        if state.status is Status.TRACKING:
            return tried + 1, error(state, T, alignment), slowest
    return TRIES, float("nan"), slowest


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="run only parts whose name holds this")
    only: str = parser.parse_args().only
    house = House(data_folder() / "house")
    images = house.film("loop")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "loop.facetmap"
        alignment = house.map(images, path)
        if only in "localise":
            localise(house, path, alignment)
        if only in "turned":
            turned_starts(house, images, path, alignment)


if __name__ == "__main__":
    main()
