"""How far the place of a board seen in a hand-held mirror can be trusted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam.calibration.boards import Board
from facetcam.calibration.hand_mirror import HandMirror, solve_without
from facetcam.errors import FacetcamError
from facetcam.geometry import se3
from facetcam.rig import Camera

Array = NDArray[np.float64]
Progress = Callable[[int, int | None], None]

_GROUPS = 10  # of poses, each left out once
_LEAST = 4  # poses from which one can be left out


@dataclass(frozen=True, slots=True)
class Sigma:
    """One standard deviation of a board's turn (radians) and of its middle (metres); NaN where unknown."""

    turn: float
    shift: float


def sigma_of(
    found: HandMirror,
    board: Board,
    camera: Camera,
    progress: Progress = lambda done, total: None,
) -> Sigma:
    """Sigma by leaving out poses of the mirror in turn (the jackknife).

    It holds all that differs from pose to pose: noise, a mirror that is not flat, a camera that moved.

    Parameters
    ----------
    found : HandMirror
        Solved from all sightings.
    board, camera
        As for `solve_hand_mirror`.
    progress : callable
        Called with groups done and groups in all.

    Returns
    -------
    Sigma
        NaN with fewer than four poses, or where those left do not fix the board.
    """
    unknown = Sigma(float("nan"), float("nan"))
    count = len(found.fit.sightings)
    if count < _LEAST:
        return unknown
    groups = min(count, _GROUPS)
    middle = np.array([*board.size, 0.0]) / 2
    turns, shifts = np.empty((groups, 3)), np.empty((groups, 3))
    for group in range(groups):
        try:
            T = solve_without(found, board, camera, range(group, count, groups)).T_cam_board
        except FacetcamError:
            return unknown
        turns[group] = se3.log(T @ se3.inverse(found.T_cam_board))[:3]
        shifts[group] = se3.transform(T, middle[None])[0]
        progress(group + 1, groups)
    spread = [np.sum((x - x.mean(axis=0)) ** 2) * (groups - 1) / groups for x in (turns, shifts)]
    return Sigma(float(np.sqrt(spread[0])), float(np.sqrt(spread[1])))


def rms_apart(found: HandMirror) -> Array:
    """RMS (N,) px of the corners kept when each image of the board may stand where it likes.

    It is free of mirrors: where it is far below `HandMirror.pose_rms`, no fixed board and camera with a flat
    mirror between them explains the photos.
    """
    camera, fit = found.rig.camera, found.fit
    out = np.full(len(fit.sightings), np.nan)
    for i, (s, (a, b)) in enumerate(zip(fit.sightings, fit.looks.bounds)):
        good = fit.kept[a:b]
        if good.sum() < _LEAST:
            continue
        rays = camera.ray(s.pixels[good])
        flat = fit.looks.points[a:b][good]
        pose = cv2.solvePnP(flat, rays[:, :2] / rays[:, 2:], np.eye(3), None, flags=cv2.SOLVEPNP_ITERATIVE)
        seen = flat @ cv2.Rodrigues(pose[1])[0].T + pose[2].ravel()
        off = camera.project(seen)[0] - s.pixels[good]
        out[i] = np.sqrt(np.mean(np.sum(off**2, axis=1)))
    return out
