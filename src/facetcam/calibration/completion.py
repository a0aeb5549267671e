"""What a first solve leaves to find: corners in views not seen yet, and the glass of the mirrors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam.calibration.bent_edges import drawn_aside
from facetcam.calibration.boards import Board
from facetcam.calibration.corners import radius_of
from facetcam.calibration.fit import Fit
from facetcam.calibration.guidance import LookAgain
from facetcam.calibration.optics import MirrorOptics
from facetcam.calibration.result import Calibration
from facetcam.calibration.sightings import Sighting
from facetcam.geometry import se3
from facetcam.rig import Glass, Rig, View

Array = NDArray[np.float64]

_SMALLEST = 7.0  # pixels a square
_ASTRAY = 0.2  # squares between where a corner is predicted and found
_LEAST = 6  # corners of a new sighting
_SHARE = 0.5  # of the corners predicted that must be there
_STEPS = (0.0, 0.002, 0.004)  # metres of glass, for mirrors at 0.5 m: where the parabola is laid
_ROUNDS = 3  # of it, each about the least of the one before


def with_all_chains(rig: Rig) -> Rig:
    """The rig with a view for every chain of up to two mirrors."""
    known = {view.mirrors for view in rig.views.values()}
    chains = [(), *((m,) for m in rig.mirrors), *permutations(rig.mirrors, 2)]
    more = {"-".join(c) or "direct": View(tuple(c)) for c in chains if tuple(c) not in known}
    open_views = {name: View(view.mirrors) for name, view in rig.views.items()}
    return replace(rig, views=open_views | more)


def completed(calibration: Calibration, look_again: LookAgain) -> tuple[Rig, list[Sighting]]:
    """Look for every board of every photo in all chains of one and two mirrors.

    Parameters
    ----------
    calibration : Calibration
        Solved with the sightings known so far; of a rig with unbounded mirrors.
    look_again : callable
        As for `solve`.

    Returns
    -------
    rig : Rig
        As solved, with a view for each chain that was seen; those of mirrors with the region where they were.
    sightings : list of Sighting
    """
    rig = with_all_chains(calibration.rig)
    out: list[Sighting] = []
    for (photo, index), T in calibration.T_rig_board.items():
        before: list[Array] = []  # outlines of what stands nearer
        known = [f.sighting for f in calibration.sightings if f.sighting.photo == photo]
        for name in sorted(rig.views, key=lambda n: len(rig.views[n].mirrors)):
            old = [s for s in known if (s.board, s.view) == (index, name)]
            found = _looked(rig, name, calibration.boards.boards[index], T, photo, index, before, look_again)
            best = max([*([found] if found else []), *old], key=len, default=None)
            if best is not None:
                out.append(best)
                outline = _outline(rig, name, calibration.boards.boards[index], T)
                before += [outline] if outline is not None else []
    names = {s.view for s in out}
    views = {
        n: View(v.mirrors, _hull(out, n) if v.mirrors else None) for n, v in rig.views.items() if n in names
    }
    return replace(rig, views=views), out


def _looked(
    rig: Rig, name: str, board: Board, T: Array, photo: int, index: int, before: list[Array], look: LookAgain
) -> Sighting | None:
    if se3.inverse(se3.inverse(rig.T_rig_image(name)) @ T)[2, 3] >= 0:
        return None  # the board turns its back

    def shown(points: Array) -> tuple[Array, NDArray[np.bool_]]:
        return rig.project(name, se3.transform(T, points))

    pixels, seen = shown(board.points)
    square = np.full(len(pixels), np.inf)
    for side in np.concatenate([np.eye(3)[:2], -np.eye(3)[:2]]) * board.corner_square:
        beside, there = shown(board.points + side)
        square = np.minimum(square, np.where(there, np.linalg.norm(beside - pixels, axis=1), 0.0))
    for outline in before:
        inside = [cv2.pointPolygonTest(outline, (float(u), float(v)), True) > -5.0 for u, v in pixels]
        seen &= ~np.array(inside)
    rows = np.flatnonzero(seen & (square > _SMALLEST))
    if len(rows) < _LEAST:
        return None
    found, good = look(photo, pixels[rows], square[rows])
    radius = radius_of(square[rows])
    found = found - drawn_aside(lambda p: shown(p)[0], board.points[rows], board.corner_square, radius)
    good &= np.linalg.norm(found - pixels[rows], axis=1) < _ASTRAY * square[rows]
    if good.sum() < max(_LEAST, _SHARE * len(rows)):
        return None
    return Sighting(photo, index, rows[good], found[good], rig.is_flipped(name), name)


def _outline(rig: Rig, name: str, board: Board, T: Array) -> Array | None:
    width, height = board.size
    corners = np.array([[0, 0, 0], [width, 0, 0], [width, height, 0], [0, height, 0]])
    pixels, seen = rig.project(name, se3.transform(T, corners))
    return pixels.astype(np.float32) if seen.all() else None


def _hull(sightings: Sequence[Sighting], view: str) -> Array:
    pixels = np.concatenate([s.pixels for s in sightings if s.view == view]).astype(np.float32)
    return np.asarray(cv2.convexHull(pixels)[:, 0], dtype=np.float64)


@dataclass(frozen=True)
class Thickness:
    """Thickness of the glass of all mirrors, in metres, with one standard deviation of it."""

    thickness: float
    sigma: float


def find_glass(fit: Fit, index: float = 1.52) -> Thickness:
    """One thickness for the glass of all mirrors of a solved rig, from the drop of the residuals.

    The sum of squares is a parabola in the thickness, the rest solved anew for each.

    Parameters
    ----------
    fit : Fit
        Of a solved calibration.
    index : float
        Refractive index taken for granted: thickness and index are hardly told apart.
    """
    scale = float(np.mean([np.linalg.norm(p.pivot) for p in _optics(fit).planes])) / 0.5
    best, sigma = 0.0, float("inf")
    for _ in range(_ROUNDS):
        steps = np.maximum(best - 2e-3 * scale, 0.0) + scale * np.array(_STEPS)
        costs = [_cost(fit, float(t), index) for t in steps]
        a, b, _ = np.polyfit(steps, costs, 2)
        if a <= 0:
            return Thickness(0.0, float("inf"))
        best = float(np.clip(-b / (2 * a), 0.0, 0.03 * scale))
        sigma = float(np.sqrt(min(costs) / (2 * max(int(fit.kept.sum()), 1)) / a))
    return Thickness(best, sigma)


def glazed(rig: Rig, thickness: float, index: float = 1.52) -> Rig:
    """The rig with this glass before all mirrors, of which a solve may change all."""
    glass = Glass(thickness, index, thickness_sigma=thickness) if thickness > 0 else None
    return replace(rig, mirrors={n: replace(m, glass=glass) for n, m in rig.mirrors.items()})


def _cost(fit: Fit, thickness: float, index: float) -> float:
    optics = _optics(fit)
    panes = np.tile((thickness, index), (len(optics.planes), 1))
    moved = replace(fit, state=replace(fit.state, optics=replace(optics, glass=panes))).solved(None, 25)
    return float(np.sum((moved.residuals / fit.looks.noise[:, None])[fit.kept] ** 2))


def _optics(fit: Fit) -> MirrorOptics:
    optics = fit.state.optics
    assert isinstance(optics, MirrorOptics)
    return optics
