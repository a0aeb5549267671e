"""Draw docs/images/overview.jpg, the picture of the README, from a folder that `facetcam demo` made."""

from __future__ import annotations

import argparse
from itertools import islice
from pathlib import Path

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from facetcam.features import SIICF
from facetcam.io.ply import VERTEX
from facetcam.io.sources import open_source
from facetcam.io.trajectories import read_tum
from facetcam.rig import Rig
from facetcam.unwrapping import unwrap
from facetcam.viz.palette import view_colour
from facetcam.viz.pictures import draw_points

CORNERS = 320
VIEW_WIDTH = 440  # pixels; the marks of corners keep their size
SEAM = np.ones((25, 25), np.uint8)  # no corners this near to the end of a mirror


def picture(axes: Axes, bgr: np.ndarray) -> None:
    axes.imshow(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB))
    axes.axis("off")


def draw_views(places: list[Axes], rig: Rig, frame: np.ndarray) -> None:
    """The four unwrapped views, each with its own corners."""
    detector = SIICF.create(max_features=CORNERS // len(places))
    unwrapper = unwrap(rig)
    for index, (axes, (name, view)) in enumerate(zip(places, unwrapper(frame).items(), strict=True)):
        corners = detector.detect(view, cv2.erode(unwrapper.mask(name), SEAM))
        marked = draw_points(view, corners.xy, np.full(len(corners), index), VIEW_WIDTH)
        picture(axes, marked)
        axes.text(10, marked.shape[0] - 12, name, color="white", fontsize=9)


def draw_path(axes: Axes, run: Path) -> None:
    """The path and the map points near it, from above."""
    positions = read_tum(run / "trajectory.tum")[1][:, :3, 3]
    body = (run / "map.ply").read_bytes().partition(b"end_header\n")[2]
    cloud, colours = (np.frombuffer(body, VERTEX)[key] for key in ("position", "colour"))
    reach = 2.5 * np.abs(positions[:, :2]).max()
    near = np.abs(cloud[:, :2]).max(axis=1) < reach
    axes.scatter(*cloud[near, :2].T, s=3, c=colours[near] / 255.0)
    axes.plot(*positions[:, :2].T, color=view_colour(0), lw=2)
    axes.set(aspect="equal", xticks=[], yticks=[])
    axes.set_title("the path and the map, from above", fontsize=10)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("demo", type=Path, help="a folder made by `facetcam demo`")
    parser.add_argument("--frame", type=int, default=32)
    parser.add_argument("--out", type=Path, default=Path("docs/images/overview.jpg"))
    options = parser.parse_args()
    rig = Rig.load(options.demo / "rig.yaml")
    with open_source(options.demo / "film.mp4") as film:
        frame = next(islice(film, options.frame, None)).image
    figure = Figure(figsize=(12, 4.15), layout="constrained")
    places = figure.subplot_mosaic("ABG;ACG;ADG;AEG", width_ratios=(4.9, 2.8, 3.9))
    rows, columns = np.nonzero(rig.labels() >= 0)
    seen = frame[rows.min() : rows.max(), columns.min() : columns.max()]
    picture(places["A"], seen)
    places["A"].set_title("one camera, four mirrors", fontsize=10)
    places["B"].set_title("four views and their corners", fontsize=10)
    draw_views([places[key] for key in "BCDE"], rig, frame)
    draw_path(places["G"], options.demo / "slam")
    figure.savefig(options.out, dpi=110, pil_kwargs={"quality": 85})


if __name__ == "__main__":
    main()
