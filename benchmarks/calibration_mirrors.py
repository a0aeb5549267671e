"""Calibration of real mirrors: a board on a table between two, and a mirror held by hand.

python benchmarks/calibration_mirrors.py table
python benchmarks/calibration_mirrors.py hand
python benchmarks/calibration_mirrors.py panes
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import cv2
import numpy as np
from _common import data_folder, show

from facetcam.calibration.boards import Board, BoardSet
from facetcam.calibration.chessboards import detect_chessboards
from facetcam.calibration.creep import CHANCE, creeps
from facetcam.calibration.fit import Fit
from facetcam.calibration.hand_mirror import solve_hand_mirror
from facetcam.calibration.least_squares import minimise
from facetcam.calibration.optics import MirrorOptics
from facetcam.calibration.problem import subset
from facetcam.calibration.result import Calibration
from facetcam.calibration.solve import solve
from facetcam.pipelines.calibrate_in_memory import calibrate
from facetcam.rig import Camera, Glass, Mirror

SQUARE = 0.03  # the table's square is not stated; all lengths scale with it
TABLE = BoardSet((Board("board", "chessboard", (8, 7), SQUARE),))


def table(folder: Path) -> None:
    """Solve the two-mirror table, and judge it by photos left out."""
    calibration = of_table(folder)
    fit: Fit = calibration.fit
    views = Counter(f.sighting.view for f in calibration.sightings)
    kept = np.concatenate([f.kept for f in calibration.sightings])
    angle, sigma = between(calibration)
    camera = calibration.rig.camera
    sigma_of = dict(zip(calibration.parameters.names, calibration.parameters.sigma))
    rows = [
        ("sightings", f"{len(calibration.sightings)}: " + ", ".join(f"{n} {v}" for v, n in views.items())),
        ("corners, cut", f"{len(kept)}, {100 * (1 - kept.mean()):.2f} %"),
        ("RMS kept, uncut", f"{calibration.rms():.3f}, {calibration.rms(False):.3f} px"),
        ("focal length x, y", f"{camera.fx:.1f} +- {sigma_of['fx']:.1f}, {camera.fy:.1f} px"),
        ("angle between the mirrors", f"{angle:.4f} +- {sigma:.4f} deg"),
        ("glass, n = 1.52", said(calibration, "left, right: thickness")),
    ]
    show("two-mirror table", ("", "value"), rows)
    held_out(fit)


def of_table(folder: Path) -> Calibration:
    """The two-mirror table solved from its photos alone."""
    return calibrate([folder / f"Image{i}.jpg" for i in range(1, 12)], TABLE)


def panes(folder: Path) -> None:
    """One glass for both mirrors against one for each: photos left out in turn tell which predicts better.

    The spread of the thicknesses over the sets that lack a photo each gives their sigma (jackknife), whatever
    the residuals of a photo have in common; the covariance takes every corner for an independent witness.
    """
    shared = of_table(folder)
    rig, rows = shared.rig, []
    apart = {n: replace(m, glass=pane_of_its_own(m, k)) for k, (n, m) in enumerate(rig.mirrors.items())}
    own = solve(replace(rig, mirrors=apart), TABLE, [f.sighting for f in shared.sightings], None)
    for name, calibration in (("shared", shared), ("one each", own)):
        whole: Fit = calibration.fit
        rest = {p: whole.of_photos([q for q in whole.photos if q != p]).solved(None) for p in whole.photos}
        thick = np.array([thicknesses(fit) for fit in rest.values()])
        spread = np.sqrt((len(thick) - 1) * thick.var(axis=0))
        off = [
            np.concatenate([predicted(whole, fit, photo, known) for photo, fit in rest.items()])
            for known in ({"direct"}, {"direct", "left"})
        ]
        cells = [f"{v:.2f} +- {s:.2f}" for v, s in zip(thicknesses(whole), spread)]
        rows.append(
            (name, f"{calibration.rms():.4f}", *cells, *(f"{np.sqrt((o**2).mean()):.3f}" for o in off))
        )
    columns = (
        "glass",
        "RMS, px",
        "left, mm",
        "right, mm",
        "left - right, mm",
        "from direct",
        "direct + left",
    )
    show("two-mirror table: glass, sigma by photos left out, and what it predicts", columns, rows)


def pane_of_its_own(mirror: Mirror, index: int) -> Glass:
    """The same glass, known too little to tie it to another's."""
    assert mirror.glass is not None
    thickness = mirror.glass.thickness + 1e-6 * index  # sheets that are drawn alike count as one
    return replace(mirror.glass, thickness=thickness, thickness_sigma=thickness)


def thicknesses(fit: Fit) -> list[float]:
    """Of the two mirrors, and their difference, mm."""
    optics = fit.state.optics
    assert isinstance(optics, MirrorOptics)
    left, right = (1e3 * optics.glass[optics.names.index(name), 0] for name in ("left", "right"))
    return [left, right, left - right]


def said(calibration: Calibration, name: str) -> str:
    """A solved number with its sigma, mm."""
    p = calibration.parameters
    found = {n: f"{value:.2f} +- {sigma:.2f} mm" for n, value, sigma in zip(p.names, p.value, p.sigma)}
    return found.get(name, "none")


def between(calibration: Calibration) -> tuple[float, float]:
    """Angle between two mirrors in degrees, with its sigma from the covariance of their planes."""
    optics = calibration.fit.state.optics
    assert isinstance(optics, MirrorOptics)

    def angle(step: np.ndarray) -> float:
        one, other = (p.plane[0] for p in optics.moved(step).planes)
        return float(180.0 - np.degrees(np.arccos(one @ other)))

    names = calibration.parameters.names
    own = [names.index(name) for name in optics.parameters if name in names]
    steps = 1e-6 * np.eye(optics.count)[[name in names for name in optics.parameters]]
    slope = np.array([(angle(s) - angle(-s)) / 2e-6 for s in steps])
    covariance = calibration.parameters.covariance[np.ix_(own, own)]
    return angle(np.zeros(optics.count)), float(np.sqrt(slope @ covariance @ slope))


def held_out(fit: Fit) -> None:
    """Leave out every photo in turn; its board's pose from some views must predict the others."""
    rows, pooled = [], {"direct": [], "direct + left": []}
    moved = {c.photo: c for c in creeps(fit)}
    for photo in fit.photos:
        rest = fit.of_photos([p for p in fit.photos if p != photo])
        rest = rest.solved(None)
        cells = [str(photo + 1)]
        for name, known in (("direct", {"direct"}), ("direct + left", {"direct", "left"})):
            off = predicted(fit, rest, photo, known)
            pooled[name].append(off)
            cells.append(f"{np.sqrt((off**2).mean()):.2f}" if len(off) else "-")
        every = predicted(fit, rest, photo, None)
        c = moved.get(photo)
        shift = (f"{c.shift:.2f} +- {c.sigma:.2f} {c.view}", f"{c.chance:.2g}") if c else ("-", "-")
        rows.append((*cells, f"{np.sqrt((every**2).mean()):.2f}", *shift))
    for name, offs in pooled.items():
        off = np.concatenate(offs)
        print(f"left out, from {name}: median {np.median(off):.3f}, RMS {np.sqrt((off**2).mean()):.3f} px")
    crept = [str(p + 1) for p, c in sorted(moved.items()) if c.chance < CHANCE]
    print(f"crept (chance under {CHANCE} over all photos): photos {', '.join(crept) or 'none'}")
    show(
        "left out in turn, RMS px",
        ("photo", "from direct", "direct + left", "pose from all", "shift of a view", "chance"),
        rows,
    )


def predicted(fit: Fit, rest: Fit, photo: int, known: set[str] | None) -> np.ndarray:
    """Distances (N,) px in the views outside `known` when the pose comes from those in it (None: all)."""
    chosen = [i for i, s in enumerate(fit.sightings) if s.photo == photo]
    start = [i for i in chosen if known is None or fit.sightings[i].view in known]
    others = chosen if known is None else [i for i in chosen if i not in start]
    state = replace(fit.state, intrinsics=rest.state.intrinsics, optics=rest.state.optics)
    looks, part, _ = subset(fit.looks, state, start)
    held = np.zeros(part.shared, dtype=bool)
    part = minimise(part, looks, held, fit.prior, 2.0, 50)
    if not others:
        return np.empty(0)
    rest_looks, _, _ = subset(fit.looks, state, others)
    return np.linalg.norm(rest_looks.pixels - part.predict(rest_looks), axis=1)


def hand(folder: Path) -> None:
    """The board's pose from some poses of the mirror against that from all five."""
    board = Board("screen", "chessboard", (11, 8), 0.0275)
    K = np.loadtxt(folder / "camera.txt", delimiter=",")
    focal = (float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2]))
    camera = Camera("brown-conrady", 1600, 1200, *focal, (0.0,) * 5)
    sightings = []
    for i in range(1, 6):
        grey = cv2.imread(str(folder / f"input{i}.jpg"), cv2.IMREAD_GRAYSCALE)
        sightings.append(detect_chessboards(grey, board, 0, i - 1)[0])
    whole = solve_hand_mirror(board, sightings, camera)
    far = float(np.linalg.norm(whole.T_cam_board[:3, 3]))
    k1, k2 = whole.rig.camera.distortion[:2]
    print(f"all five: RMS {whole.rms:.3f} px, distance {far:.4f} m, k1 {k1:.4f}, k2 {k2:.4f}")
    rows = []
    for count in (4, 3):
        differences = []
        for chosen in combinations(range(5), count):
            T = solve_hand_mirror(board, [sightings[i] for i in chosen], camera).T_cam_board
            turn = whole.T_cam_board[:3, :3].T @ T[:3, :3]
            angle = np.degrees(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1)))
            shift = 100 * np.linalg.norm(T[:3, 3] - whole.T_cam_board[:3, 3]) / far
            differences.append((angle, shift))
            rows.append((", ".join(str(i + 1) for i in chosen), f"{angle:.3f}", f"{shift:.3f}"))
        middle, worst = np.median(differences, axis=0), np.max(differences, axis=0)
        said = [f"{m:.3f} deg, {s:.3f} %" for m, s in (middle, worst)]
        print(f"any {count}: median {said[0]}; worst {said[1]}")
    show("board's pose against that from all five mirror poses", ("poses", "deg", "% of distance"), rows)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables of one of them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("which", choices=("table", "hand", "panes"))
    which = parser.parse_args(arguments).which
    folder = data_folder() / "mirrors"
    cv2.setNumThreads(1)
    if which == "hand":
        hand(folder / "one-mirror")
    else:
        {"table": table, "panes": panes}[which](folder / "two-mirror-table")


if __name__ == "__main__":
    main()
