"""Two frames: a motion that wheels have measured, as corners confirm it, turn it or deny it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from facetcam.geometry import se3
from facetcam.slam.camera.frame import Corners
from facetcam.slam.camera.optics import Optics
from facetcam.slam.config import SlamConfig
from facetcam.slam.relative_pose.degenerate import on_the_spot, standing_views
from facetcam.slam.relative_pose.epipolar import match_along_epipolars
from facetcam.slam.relative_pose.measured_motion import Measured
from facetcam.slam.relative_pose.pairs import EPIPOLAR_GATE, SLIGHT_PARALLAX, START_PARALLAX, Pairs
from facetcam.slam.relative_pose.proposals import rig_motion
from facetcam.slam.relative_pose.two_frames import (
    AGREEING,
    LEAST_GOOD,
    STANDING,
    agreed,
    borne_out_elsewhere,
    polished,
)
from facetcam.slam.relative_pose.witnesses import dissenting, shares

Array = NDArray[np.float64]
Index = NDArray[np.int64]

MIN_CONFIRMING = 40  # pairs that confirm a motion which wheels have told
START_GATE = 8.0  # px: odometry and the first guess of the scale are rough
_CONFIRMING = 0.7  # share of the pairs
_MOST_TURNED = 0.2  # radians by which the images may correct a motion measured otherwise
_MOST_ASIDE = 0.3  # radians by which they may correct its direction
_MOST_STRETCHED = 2.0  # factor of its length


def enough_parallax(
    a: Corners, b: Corners, T_a_b: Array, optics: Optics, config: SlamConfig, aside: Index, several: bool
) -> bool:
    """Tell whether two frames with a measured motion can start a map without the views set `aside`.

    Where `several` views could tell, more than one must show it. The images have confirmed the motion before,
    so fewer pairs do than where they must find it. A turn on the spot shows slight parallax at most before
    what is seen has left its view.
    """
    spot = on_the_spot(T_a_b, optics)
    gate, parallax = (EPIPOLAR_GATE, SLIGHT_PARALLAX) if spot else (START_GATE, START_PARALLAX)
    rows_a, rows_b = (np.flatnonzero(~np.isin(corners.views, aside)) for corners in (a, b))
    rows = match_along_epipolars(a, rows_a, b, rows_b, T_a_b, gate, optics, config)
    good = Pairs.of(a, rows[0], b, rows[1]).count_good(T_a_b, optics, gate, parallax)
    return good.sum() >= LEAST_GOOD and (not several or borne_out_elsewhere(good, good))


def confirmed_motion(pairs: Pairs, measured: Measured, optics: Optics) -> Array | None:
    """Motion that was measured otherwise, turned as the images say; None where they say something else.

    Wheels may slip and their clock be off: the length is theirs, and turn and direction as far as the images
    cannot tell them. A wall that one view sees moves alike whether the rig goes along it or turns. A turn on
    the spot is theirs but for its tilt: it moves views sideways, which a nearer world would explain as well.
    """
    T_a_b, pairs = measured.T_a_b, pairs.without(standing_views(pairs))
    if len(pairs) >= MIN_CONFIRMING and on_the_spot(T_a_b, optics):
        best = polished(T_a_b, pairs, optics, measured, only_turn=True)
        return best if _confirm(pairs, best, optics) and _turned(best, T_a_b) < _MOST_TURNED else None
    if len(pairs) < MIN_CONFIRMING or np.linalg.norm(T_a_b[:3, 3]) < STANDING:
        return T_a_b
    turned = np.stack([polished(T, pairs, optics, measured) for T in _turned_otherwise(pairs, T_a_b, optics)])
    best = turned[int(np.argmin(pairs.misfit(turned, optics) + measured.misfit(turned)))]
    against = dissenting(pairs.views, pairs.fit(best, optics), AGREEING)
    if against is None or len(against) or not much_alike(best, T_a_b):
        pairs, best = _suiting_most(pairs, measured, optics)
    return best if _confirm(pairs, best, optics) and much_alike(best, T_a_b) else None


def _confirm(pairs: Pairs, T_a_b: Array, optics: Optics) -> bool:
    """Tell whether most pairs fit a motion, in half of the views at least."""
    fits = pairs.fit(T_a_b, optics)
    by_view = shares(pairs.views, fits)[1]
    return bool(fits.mean() > _CONFIRMING and 2 * np.sum(by_view < AGREEING) <= len(by_view))


def _turned_otherwise(pairs: Pairs, T_a_b: Array, optics: Optics) -> list[Array]:
    """A motion as it was measured, and with the turns that the images propose."""
    proposals = [T_a_b, _with_turn_alone(pairs, T_a_b, optics)]
    whole = rig_motion(pairs, optics)
    if whole is not None:
        whole[:3, 3] *= np.linalg.norm(T_a_b[:3, 3])
        proposals.append(whole)
    return proposals


def _suiting_most(pairs: Pairs, measured: Measured, optics: Optics) -> tuple[Pairs, Array]:
    """Where views contradict each other: what one of them makes of a motion and most of them bear out."""
    T_a_b = measured.T_a_b
    proposals = [T_a_b]
    for view in shares(pairs.views, pairs.move())[0]:
        own = pairs.without(np.setdiff1d(pairs.views, view))
        proposals += [polished(T, own, optics, measured) for T in _turned_otherwise(own, T_a_b, optics)]
    alike = np.stack([T for T in proposals if much_alike(T, T_a_b)])
    share = shares(pairs.views, pairs.fit(alike, optics))[1].sum(axis=-1)
    share -= np.array([_turned(T, T_a_b) for T in alike]) / _MOST_TURNED  # what measured it is a witness, too
    return agreed(pairs, alike[int(np.argmax(share))], optics, measured)


def _with_turn_alone(pairs: Pairs, T_a_b: Array, optics: Optics) -> Array:
    """A motion with the turn that explains the images best without any way."""
    return se3.from_rotation_translation(pairs.pure_rotation(optics)[0], T_a_b[:3, 3])


def much_alike(T: Array, T_measured: Array) -> bool:
    """False where the images would correct a motion so far that they rather deny it."""
    a, b = T[:3, 3], T_measured[:3, 3]
    stretched = float(np.linalg.norm(a)) / max(float(np.linalg.norm(b)), STANDING)
    aside = float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))
    alike = _turned(T, T_measured) < _MOST_TURNED and aside < _MOST_ASIDE
    return alike and 1.0 / _MOST_STRETCHED < stretched < _MOST_STRETCHED


def _turned(T: Array, T_measured: Array) -> float:
    """Angle in radians between two motions' turns."""
    return float(np.linalg.norm(se3.log(se3.inverse(T_measured) @ T)[:3]))
