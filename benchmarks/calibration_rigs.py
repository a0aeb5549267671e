"""Calibration of rigs and targets of many kinds, from ray-traced photos, against the rigs that took them.

python benchmarks/calibration_rigs.py [CASE ...] [--photos FOLDER]
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from _common import show

from facetcam.calibration.board_files import write_boards
from facetcam.calibration.boards import Board, BoardSet
from facetcam.calibration.covariance import knowledge
from facetcam.calibration.difference import projection_difference, room_points
from facetcam.calibration.result import Calibration
from facetcam.calibration.uncertainty import aligned_slopes
from facetcam.errors import FacetcamError
from facetcam.geometry import se3
from facetcam.pipelines.calibrate import run_calibration
from facetcam.rig import Camera, Mirror, Rig, View, presets

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from calibration_worlds import boards, disturbed, facing, walk
from rendered_boards import write_board_photos

BROWN = (-0.1, 0.03, 2e-4, -3e-4, 0.0)
POINTS = 2000  # a view, 0.5 to 6 m away


@dataclass(frozen=True)
class Case:
    """A rig and its boards; `fill` says how large a board stands in a view."""

    rig: Rig
    boards: BoardSet
    photos: int = 14
    fill: float = 0.9
    drawn: bool = True

    def placed(self, seed: int) -> list[dict[int, np.ndarray]]:
        """Where the boards stand in each photo; on the table one before the mirrors, seen in all of them."""
        if "left_right" not in self.rig.views:
            return walk(self.rig, self.boards, self.photos, seed, self.fill)
        random = np.random.default_rng(seed)
        board, eye = self.boards.boards[0], self.rig.T_rig_cam[:3, 3]
        places = [np.array([0.0, -0.26, 0.14]) + random.uniform(-0.06, 0.06, 3) for _ in range(self.photos)]
        away = [(at - eye) / np.linalg.norm(at - eye) for at in places]
        return [
            {0: facing(board, eye, d, float(np.linalg.norm(at - eye)), random)} for at, d in zip(places, away)
        ]


def bent(rig: Rig, distortion: tuple[float, ...] = BROWN) -> Rig:
    """The rig with another lens of the same focal length."""
    model = "brown-conrady" if len(distortion) == 5 else "kannala-brandt"
    return replace(rig, camera=replace(rig.camera, model=model, distortion=distortion))


def plain(camera: Camera) -> Rig:
    """A camera without mirrors."""
    return Rig(camera, np.eye(4), {}, {"direct": View(())})


def stereo_adapter() -> Rig:
    """Four mirrors before a lens, which shows the room from two places side by side."""
    upright = [-0.05, 0.05], [-0.13, 0.13]
    mirrors, views = {}, {}
    for name, side in (("left", -1.0), ("right", 1.0)):
        inner = np.array([[0.0, 0.05], [0.055 * side, 0.105]])
        outer = np.array([[0.065 * side, 0.04], [0.2 * side, 0.175]])
        middle, toe = outer.mean(axis=0), np.radians(6.0) * side
        turn = np.array([[np.cos(toe), -np.sin(toe)], [np.sin(toe), np.cos(toe)]])
        outer = middle + (outer - middle) @ turn.T
        for part, feet, (low, high) in (("inner", inner, upright[0]), ("outer", outer, upright[1])):
            polygon = [[*feet[0], low], [*feet[1], low], [*feet[1], high], [*feet[0], high]]
            mirrors[f"{part}_{name}"] = Mirror.from_polygon(f"{part}_{name}", np.array(polygon))
        views[name] = View((f"inner_{name}", f"outer_{name}"))
    T_rig_cam = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
    camera = Camera("brown-conrady", 1600, 1200, 1700.0, 1700.0, 799.5, 599.5, BROWN)
    return Rig(camera, T_rig_cam, mirrors, views)


def april(count: int, tag: float, fixed: bool) -> BoardSet:
    """AprilGrids as Kalibr prints them, smaller."""
    made = [
        Board(f"april{k}", "aprilgrid", (6, 5), 1.3 * tag, tag, "DICT_APRILTAG_36h11", 30 * k)
        for k in range(count)
    ]
    return BoardSet(tuple(made), fixed)


def checkers(square: float) -> BoardSet:
    """One plain chessboard."""
    return BoardSet((Board("plain", "chessboard", (10, 7), square),), False)


def sizes() -> BoardSet:
    """Boards of three sizes."""
    kinds = ((0.03, (11, 8)), (0.05, (9, 7)), (0.09, (6, 5)))
    made: list[Board] = []
    for k in range(9):
        square, squares = kinds[k % 3]
        first = made[-1].ids.stop if made else 0
        made.append(
            Board(f"b{k}", "charuco", squares, square, 0.75 * square, "DICT_5X5_1000", first_id=first)
        )
    return BoardSet(tuple(made), True)


def small_dictionary() -> BoardSet:
    """Three boards of the dictionary whose mirror images read as other markers."""
    made = [
        Board(f"four{k}", "charuco", (8, 4), 0.06, 0.045, "DICT_4X4_50", first_id=16 * k) for k in range(3)
    ]
    return BoardSet(tuple(made), True)


CASES: dict[str, Callable[[], Case]] = {
    "pyramid of 5": lambda: Case(bent(presets.pyramid(5)), boards(8, True)),
    "pyramid, 3 sizes": lambda: Case(bent(presets.pyramid()), sizes()),
    "pyramid, aprilgrid": lambda: Case(bent(presets.pyramid(3)), april(6, 0.06, True)),
    "ryu, kannala-brandt": lambda: Case(bent(presets.ryu(), (0.05, -0.03, 0.01, 0.0)), boards(8, True)),
    "ryu, DICT_4X4_50": lambda: Case(bent(presets.ryu()), small_dictionary(), 20),
    "table, charuco": lambda: Case(bent(presets.table()), boards(1, False, 0.018, (9, 7))),
    "table, aprilgrid": lambda: Case(bent(presets.table()), april(1, 0.02, False)),
    "table, chessboard": lambda: Case(bent(presets.table()), checkers(0.016)),
    "stereo adapter": lambda: Case(stereo_adapter(), boards(1, False, 0.04, (11, 8))),
    "camera, chessboard": lambda: Case(
        plain(Camera("brown-conrady", 1600, 1200, 1300.0, 1295.0, 790.0, 610.0, BROWN)), checkers(0.04)
    ),
    "wide camera": lambda: Case(
        plain(Camera("kannala-brandt", 1600, 1200, 520.0, 519.0, 790.0, 610.0, (-0.02, 0.004, -1e-3, 0.0))),
        april(1, 0.06, False), fill=0.6,
    ),
    "table, no drawing": lambda: Case(
        bent(presets.table()), boards(1, False, 0.018, (9, 7)), drawn=False
    ),
    "table, chessboard, no drawing": lambda: Case(
        bent(presets.table()), checkers(0.016), drawn=False
    ),
}  # fmt: skip


def photographed(name: str, case: Case, folder: Path, seed: int) -> Path:
    """Photos of a case; those that are there are taken as they are."""
    photos = folder / name.replace(", no drawing", "").replace(",", "").replace(" ", "-")
    if not (photos / "boards.yaml").exists():
        write_board_photos(photos, case.rig, case.boards, case.placed(seed), seed)
        write_boards(case.boards, photos / "boards.yaml")
    return photos


def judged(name: str, folder: Path, seed: int, holdout: bool) -> list[str]:
    """Photograph, calibrate from a disturbed drawing or none, and compare with the truth."""
    case = CASES[name]()
    photos = photographed(name, case, folder, seed)
    start = disturbed(case.rig, 3.0, 0.005, 0.1, seed) if case.drawn else None
    began = time.process_time()
    try:
        with tempfile.TemporaryDirectory() as scratch:
            run = run_calibration(
                photos, photos / "boards.yaml", Path(scratch) / "out", rig=start, holdout=holdout,
                cache=folder / "cache",
            )  # fmt: skip
    except FacetcamError as error:
        print(f"{name}: {error}")
        return [name, "failed", *["-"] * 5]
    seconds = time.process_time() - began
    for line in (*run.warnings, *(f.text for f in run.calibration.findings)):
        print(f"{name}: {line}")
    solved = run.calibration.rig
    shared = matching(case.rig, solved) if start is None else {v: v for v in case.rig.views}
    true = replace(case.rig, views={shared[v]: view for v, view in case.rig.views.items() if v in shared})
    points = room_points(true, list(true.views), POINTS)
    after = projection_difference(true, solved, points)
    before = f"{projection_difference(true, start, points).rms:.0f}" if start is not None else "-"
    held = f"{run.validation.held_out_rms:.3f}" if run.validation is not None else "-"
    return [
        name,
        before,
        f"{after.rms:.4f}",
        f"{expected(run.calibration):.4f}",
        f"{100 * (solved.camera.fx / case.rig.camera.fx - 1):+.4f}",
        f"{run.calibration.rms():.4f}" + (f" / {held}" if holdout else ""),
        f"{seconds:.0f}",
    ]


def expected(calibration: Calibration) -> float:
    """Distance from the truth, RMS px over all views, that the sigmas of a calibration speak of."""
    known = knowledge(calibration.fit, calibration.noise)
    J = aligned_slopes(calibration.fit, known)[1]
    return float(np.sqrt(2.0 * np.mean(np.sum((J @ known.covariance) * J, axis=1))))


def matching(true: Rig, found: Rig) -> dict[str, str]:
    """Views of a rig found without a drawing for those of the true one, by the normals of their mirrors."""
    T = found.T_rig_cam @ se3.inverse(true.T_rig_cam)
    names = {
        name: max(
            found.mirrors, key=lambda m: abs(float(found.mirrors[m].normal @ T[:3, :3] @ mirror.normal))
        )
        for name, mirror in true.mirrors.items()
    }
    chains = {view.mirrors: name for name, view in found.views.items()}
    wanted = {name: tuple(names[m] for m in view.mirrors) for name, view in true.views.items()}
    return {name: chains[chain] for name, chain in wanted.items() if chain in chains}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cases", nargs="*", metavar="CASE", help=", ".join(CASES))
    parser.add_argument("--photos", type=Path, help="folder in which photos are kept for another time")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--holdout", action="store_true", help="judge held-out photos too")
    chosen = parser.parse_args()
    unknown = [name for name in chosen.cases if name not in CASES]
    if unknown:
        parser.error(f"no case {unknown[0]!r}; there are {', '.join(CASES)}")
    with tempfile.TemporaryDirectory() as scratch:
        folder = chosen.photos or Path(scratch)
        rows = [judged(name, folder, chosen.seed, chosen.holdout) for name in chosen.cases or CASES]
    columns = (
        "rig, target",
        "drawn",
        "solved",
        "by sigma",
        "f, %",
        "RMS",
        "CPU s",
    )
    show("Rigs and targets, from drawings 3 degrees, 5 mm and 10 % off", columns, rows)


if __name__ == "__main__":
    main()
