"""What `facetcam calibrate` takes for many photos: processor time and memory, with nothing remembered.

python benchmarks/calibration_many.py [--count 500] [--photos FOLDER]
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from _common import show
from numpy.typing import NDArray

from facetcam.calibration.board_files import write_boards
from facetcam.calibration.boards import Board, BoardSet
from facetcam.calibration.difference import projection_difference, room_points
from facetcam.geometry import se3
from facetcam.rig import Rig, presets

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from board_photos import PIXELS, drawing
from calibration_worlds import boards, disturbed, walk

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

POINTS = 2000  # a view, 0.5 to 6 m away
NEAREST = 0.05  # metres: boards that come nearer, or behind the camera, are left out of a view
# From metres on a board to texels of its drawing with the rim, and from pixels to samples twice as fine.
TEXELS = np.linalg.inv([[PIXELS, 0, 20 - 0.5], [0, PIXELS, 20 - 0.5], [0, 0, 1.0]])
SAMPLES = np.array([[2, 0, 0.5], [0, 2, 0.5], [0, 0, 1.0]])


def photograph(folder: Path, count: int) -> None:
    """Photos of six fixed boards by a folded rig whose lens does not distort: each view is a homography."""
    (folder / "photos").mkdir(parents=True)
    rig, set = straight(presets.ryu()), boards(6, True)
    for index, placed in enumerate(places(rig, set, count)):
        name = folder / "photos" / f"{index:04d}.jpg"
        cv2.imwrite(str(name), picture(rig, set, placed, index), [cv2.IMWRITE_JPEG_QUALITY, 95])
    write_boards(set, folder / "boards.yaml")
    rig.save(folder / "rig_true.yaml")
    disturbed(rig, 2.0, 0.004, 0.05, 4).save(folder / "rig_nominal.yaml")


def straight(rig: Rig) -> Rig:
    """The rig with a lens that does not distort."""
    return replace(rig, camera=replace(rig.camera, distortion=(0.0,) * 5))


def places(rig: Rig, set: BoardSet, count: int) -> Iterator[dict[int, Array]]:
    """Poses of the boards in the rig that moves about one place."""
    random = np.random.default_rng(11)
    world = walk(rig, set, 1, 3)[0]
    for _ in range(count):
        turn = np.r_[random.normal(0, 0.1, 2), random.normal(0, 0.35), random.normal(0, 0.12, 3)]
        yield {board: se3.exp(turn) @ T for board, T in world.items()}


def picture(rig: Rig, set: BoardSet, placed: Mapping[int, Array], seed: int) -> Image:
    """One photo, view by view, with blur and noise."""
    width, height = rig.size
    labels, image = rig.labels(), np.full((height, width), 110, np.uint8)
    for view in rig.views:
        fine = np.full((2 * height, 2 * width), 110, np.uint8)
        T_image_rig = se3.inverse(rig.T_rig_image(view))
        for index in sorted(placed, key=lambda b: -float(np.linalg.norm(placed[b][:3, 3]))):
            lay(fine, rig, set.boards[index], T_image_rig @ placed[index])
        seen = labels == rig.view_names.index(view)
        image[seen] = cv2.resize(fine, (width, height), interpolation=cv2.INTER_AREA)[seen]
    noise = np.random.default_rng([seed, 1]).normal(0, 1.5, image.shape)
    return np.clip(0.8 * cv2.GaussianBlur(image, (0, 0), 0.6) + 20 + noise, 0, 255).astype(np.uint8)


def lay(fine: Image, rig: Rig, board: Board, T: Array) -> None:
    """Draw a board over what stands behind it, if its face is turned to the camera and before it."""
    camera, (w, h) = rig.camera, board.size
    depths = (T @ np.array([[0, 0, 0, 1], [w, 0, 0, 1], [0, h, 0, 1], [w, h, 0, 1.0]]).T)[2]
    if se3.inverse(T)[2, 3] >= 0 or depths.min() < NEAREST:
        return
    K = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
    H = SAMPLES @ K @ T[:3, [0, 1, 3]] @ TEXELS
    size = fine.shape[1], fine.shape[0]
    cv2.warpPerspective(drawing(board), H, size, fine, cv2.INTER_LINEAR, cv2.BORDER_TRANSPARENT)


def calibrated(folder: Path, out: Path) -> tuple[float, float]:
    """Processor seconds and peak memory in MB of the command."""
    facetcam = Path(sys.executable).with_name("facetcam")
    given = ["--rig", folder / "rig_nominal.yaml", "--boards", folder / "boards.yaml"]
    kept = ["--cache", out.with_name("cache"), "--out", out]
    subprocess.run([facetcam, "calibrate", folder / "photos", *given, *kept], check=True)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime, used.ru_maxrss / 1024


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=500)
    parser.add_argument("--photos", type=Path, help="folder in which the photos are kept for another time")
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = chosen.photos or Path(scratch) / "many"
        if not folder.exists():
            photograph(folder, chosen.count)
        seconds, peak = calibrated(folder, Path(scratch) / "out")
        true, solved = (Rig.load(f) for f in (folder / "rig_true.yaml", Path(scratch) / "out" / "rig.yaml"))
    off = projection_difference(true, solved, room_points(true, list(true.views), POINTS)).rms
    count = len(list((folder / "photos").iterdir())) if folder.exists() else chosen.count
    rows = [
        ["photos", str(count)],
        ["processor time", f"{seconds:.0f} s"],
        ["peak memory", f"{peak:.0f} MB"],
        ["off the truth", f"{off:.4f} px"],
    ]
    show("Many photos, judging and report included", ("", "value"), rows)


if __name__ == "__main__":
    main()
