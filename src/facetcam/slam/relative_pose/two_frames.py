"""Two frames: the motion between them from their matching corners alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from facetcam.geometry import se3
from facetcam.slam.camera.frame import Corners
from facetcam.slam.camera.optics import Optics
from facetcam.slam.config import SlamConfig
from facetcam.slam.relative_pose.degenerate import all_near, shows_a_way, standing_views, undecided
from facetcam.slam.relative_pose.epipolar import match_along_epipolars
from facetcam.slam.relative_pose.measured_motion import EPIPOLAR_SIGMA, MEASURED_SHARE, Measured
from facetcam.slam.relative_pose.pairs import EPIPOLAR_GATE, SLIGHT_PARALLAX, Pairs
from facetcam.slam.relative_pose.proposals import joint_proposal, rig_motion, view_motions
from facetcam.slam.relative_pose.witnesses import dissenting, shares

Array = NDArray[np.float64]
Index = NDArray[np.int64]

MIN_MATCHES = 60  # pairs that tell a motion by themselves
MIN_CONFIRMING = 40  # and that confirm one which wheels have told
START_GATE = 8.0  # px: odometry and the first guess of the scale are rough
_LEAST_GOOD = 30  # pairs with parallax that fit a motion
_BEARING_OUT = 12  # of other views
_TWIST_STEP = 1e-6  # radians, metres
_SETTLED = 1e-5  # of the squared errors, by which a step must lessen them to be worth another
_LENGTH_PRIOR = 3.0
_FITTING = 0.75  # share of the matches that the right motion explains
_FITTING_BOTH = 0.55  # and where one view and the others have enough each that tell it
_AGREEING = 0.5  # share of a view's pairs, below which it is no witness of a motion
_AGREEING_ROUNDS = 2
STANDING = 1e-4  # metres
_CONFIRMING = 0.7  # share of them
_MOST_TURNED = 0.2  # radians by which the images may correct a motion measured otherwise
_MOST_ASIDE = 0.3  # radians by which they may correct its direction
_MOST_STRETCHED = 2.0  # factor of its length
_MOST_COLLAPSED = 4.0  # factor of a proposed length: lengths proposed span as much


def enough_parallax(
    a: Corners, b: Corners, T_a_b: Array, optics: Optics, config: SlamConfig, aside: Index, several: bool
) -> bool:
    """Tell whether two frames with a measured motion can start a map without the views set `aside`.

    Where `several` views could tell, more than one must show it. The images have confirmed the motion before,
    so fewer pairs do than where they must find it.
    """
    rows_a, rows_b = (np.flatnonzero(~np.isin(corners.views, aside)) for corners in (a, b))
    rows = match_along_epipolars(a, rows_a, b, rows_b, T_a_b, START_GATE, optics, config)
    good = Pairs.of(a, rows[0], b, rows[1]).count_good(T_a_b, optics, START_GATE)
    return good.sum() >= _LEAST_GOOD and (not several or _borne_out(good, good))


def _borne_out(good: Index, slight: Index) -> bool:
    """A wall close to one view is a plane, which leaves a motion ambiguous, and a person before it moves by
    himself: other views than the one with most `good` pairs must bear it out, by `slight` parallax at least.
    """
    return bool(slight.sum() - slight[good.argmax()] >= _BEARING_OUT)


def estimate_motion(pairs: Pairs, optics: Optics, several: bool = False) -> Array | None:
    """Motion `T_a_b` between two frames from their corners alone, or None where they cannot tell.

    Each view proposes a rotation and a direction (PoseLib, five points), to which the length is added with
    which all views agree best; where a view denies the best of them, all views but one propose, too. The one
    that most views bear out wins, polished without those that deny it. `several` tells that more than one
    view has something to show, though it may not be found again here.
    """
    torn, pairs = undecided(pairs), pairs.without(standing_views(pairs))
    if torn or len(pairs) < MIN_MATCHES or not shows_a_way(pairs, optics):
        return None
    proposal = joint_proposal(pairs, view_motions(pairs, optics), optics)
    if proposal is None:
        return None
    proposal, agreeing, best = _most_agreed(pairs, proposal, optics)
    if len(agreeing) < MIN_MATCHES or not shows_a_way(agreeing, optics) or _collapsed(best, proposal):
        return None
    if all_near(agreeing, best, optics):
        return None
    good = agreeing.count_good(best, optics, EPIPOLAR_GATE)
    slight = agreeing.count_good(best, optics, EPIPOLAR_GATE, SLIGHT_PARALLAX)
    alone = not several and len(shares(pairs.views, pairs.move())[0]) < 2
    fitting = _FITTING_BOTH if _told_twice(good, optics) else _FITTING
    fits = np.mean(agreeing.fit(best, optics)) > fitting
    borne_out = alone or _borne_out(good, slight)
    return best if fits and good.sum() >= _LEAST_GOOD and borne_out else None


def _told_twice(good: Index, optics: Optics) -> bool:
    """Tell whether a view, and all others together that do not see the same things, tell a motion each."""
    telling = np.flatnonzero(good >= _LEAST_GOOD).tolist()
    return any(good[_apart_from(view, optics)].sum() >= _LEAST_GOOD for view in telling)


def _apart_from(view: int, optics: Optics) -> list[int]:
    """Views that see other things than one of them does."""
    beside = {u for pair in optics.overlapping if view in pair for u in pair} | {view}
    return [u for u in range(optics.n_views) if u not in beside]


def _most_agreed(pairs: Pairs, proposal: Array, optics: Optics) -> tuple[Array, Pairs, Array]:
    """The proposal that most views bear out, the pairs of those that agree, and what they make of it."""
    agreeing, best = _agreed(pairs, proposal, optics)
    if np.all(shares(pairs.views, pairs.fit(best, optics))[1] >= _AGREEING):
        return proposal, agreeing, best
    tried = np.stack([best, *_of_all_but_one(pairs, optics)])
    most = int(np.argmax(shares(pairs.views, pairs.fit(tried, optics))[1].sum(axis=-1)))
    return (tried[most], *_agreed(pairs, tried[most], optics)) if most else (proposal, agreeing, best)


def _of_all_but_one(pairs: Pairs, optics: Optics) -> list[Array]:
    """What the others say without each view: people may fill it, and outnumber them all."""
    witnesses = shares(pairs.views, pairs.move())[0]
    motions = []
    for view in witnesses if len(witnesses) > 2 else witnesses[:0]:
        others = pairs.without(np.array([view]))
        T = joint_proposal(others, {}, optics)
        if T is not None and not _collapsed(best := polished(T, others, optics), T):
            motions.append(best)
    return motions


def _collapsed(T_a_b: Array, T_proposed: Array) -> bool:
    """Tell whether pairs drive a length to nothing, or beyond all bounds: the turn alone explains them."""
    lengths = [np.linalg.norm(T[:3, 3]) for T in (T_a_b, T_proposed)]
    return bool(max(lengths) > _MOST_COLLAPSED * min(lengths))


def _agreed(
    pairs: Pairs, T_a_b: Array, optics: Optics, measured: Measured | None = None
) -> tuple[Pairs, Array]:
    """Motion polished by the views that agree with it, and their pairs; all pairs without a majority."""
    agreeing, best = pairs, T_a_b
    for _ in range(_AGREEING_ROUNDS):
        against = dissenting(pairs.views, pairs.fit(best, optics), _AGREEING)
        agreeing = pairs if against is None else pairs.without(against)
        best = polished(best, agreeing, optics, measured)
    return agreeing, best


def confirmed_motion(pairs: Pairs, measured: Measured, optics: Optics) -> Array | None:
    """Motion that was measured otherwise, turned as the images say; None where they say something else.

    Wheels may slip and their clock be off: the length is theirs, and turn and direction as far as the images
    cannot tell them. A wall that one view sees moves alike whether the rig goes along it or turns.
    """
    T_a_b, pairs = measured.T_a_b, pairs.without(standing_views(pairs))
    if len(pairs) < MIN_CONFIRMING or np.linalg.norm(T_a_b[:3, 3]) < STANDING:
        return T_a_b
    turned = np.stack([polished(T, pairs, optics, measured) for T in _turned_otherwise(pairs, T_a_b, optics)])
    best = turned[int(np.argmin(pairs.misfit(turned, optics) + measured.misfit(turned)))]
    against = dissenting(pairs.views, pairs.fit(best, optics), _AGREEING)
    if against is None or len(against) or not much_alike(best, T_a_b):
        pairs, best = _suiting_most(pairs, measured, optics)
    fits = pairs.fit(best, optics)
    by_view = shares(pairs.views, fits)[1]
    confirmed = fits.mean() > _CONFIRMING and 2 * np.sum(by_view < _AGREEING) <= len(by_view)
    return best if confirmed and much_alike(best, T_a_b) else None


def _turned_otherwise(pairs: Pairs, T_a_b: Array, optics: Optics) -> list[Array]:
    """A motion as it was measured, and with the turns that the images propose."""
    proposals = [T_a_b, _on_the_spot(pairs, T_a_b, optics)]
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
    return _agreed(pairs, alike[int(np.argmax(share))], optics, measured)


def _on_the_spot(pairs: Pairs, T_a_b: Array, optics: Optics) -> Array:
    """A motion with the turn that explains the images best without any way."""
    return se3.from_rotation_translation(pairs.pure_rotation(optics)[0], T_a_b[:3, 3])


def much_alike(T: Array, T_measured: Array) -> bool:
    """False where the images would correct a motion so far that they rather deny it."""
    a, b = T[:3, 3], T_measured[:3, 3]
    stretched = float(np.linalg.norm(a) / np.linalg.norm(b))
    aside = float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))
    alike = _turned(T, T_measured) < _MOST_TURNED and aside < _MOST_ASIDE
    return alike and 1.0 / _MOST_STRETCHED < stretched < _MOST_STRETCHED


def _turned(T: Array, T_measured: Array) -> float:
    """Angle in radians between two motions' turns."""
    return float(np.linalg.norm(se3.log(se3.inverse(T_measured) @ T)[:3]))


def joint_motion(pairs: Pairs, proposals: dict[int, Array], optics: Optics) -> Array | None:
    """Motion of the rig that suits most views, from what single views propose."""
    best = joint_proposal(pairs, proposals, optics)
    return None if best is None else polished(best, pairs, optics)


def polished(T_a_b: Array, pairs: Pairs, optics: Optics, measured: Measured | None = None) -> Array:
    """The motion with the least epipolar errors of all views; they move its length as far as they know it.

    What was `measured` counts for a share of the pairs.
    """
    length = float(np.linalg.norm(T_a_b[:3, 3]))
    times = 0 if measured is None else max(round(MEASURED_SHARE * len(pairs)), 1)

    def residuals(twists: Array) -> Array:
        T = T_a_b @ se3.exp(twists)
        stretch = np.log(np.maximum(np.linalg.norm(T[..., :3, 3], axis=-1), 1e-9) / length)
        told = [pairs.epipolar_errors(T, optics), _LENGTH_PRIOR * stretch[..., None]]
        told += [] if measured is None else times * [EPIPOLAR_SIGMA * measured.off(T)]
        return np.concatenate(told, axis=-1)

    def jacobian(twist: Array) -> Array:
        moved = residuals(twist + _TWIST_STEP * np.concatenate([np.eye(6), -np.eye(6)]))
        return np.asarray((moved[:6] - moved[6:]).T / (2.0 * _TWIST_STEP))

    solution = least_squares(
        residuals, np.zeros(6), jacobian, loss="cauchy", f_scale=EPIPOLAR_SIGMA, ftol=_SETTLED, max_nfev=30
    )
    return T_a_b @ se3.exp(solution.x)
