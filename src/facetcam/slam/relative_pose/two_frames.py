"""Two frames: the motion between them from their matching corners alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from facetcam.geometry import se3
from facetcam.slam.camera.optics import Optics
from facetcam.slam.relative_pose.degenerate import all_near, shows_a_way, standing_views, undecided
from facetcam.slam.relative_pose.measured_motion import EPIPOLAR_SIGMA, MEASURED_SHARE, Measured
from facetcam.slam.relative_pose.pairs import EPIPOLAR_GATE, SLIGHT_PARALLAX, Pairs
from facetcam.slam.relative_pose.proposals import joint_proposal, view_motions
from facetcam.slam.relative_pose.witnesses import dissenting, shares

Array = NDArray[np.float64]
Index = NDArray[np.int64]

MIN_MATCHES = 60  # pairs that tell a motion by themselves
LEAST_GOOD = 30  # pairs with parallax that fit a motion
_BEARING_OUT = 12  # of other views
_TWIST_STEP = 1e-6  # radians, metres
_SETTLED = 1e-5  # of the squared errors, by which a step must lessen them to be worth another
_LENGTH_PRIOR = 3.0
_FITTING = 0.75  # share of the matches that the right motion explains
_FITTING_BOTH = 0.55  # and where one view and the others have enough each that tell it
AGREEING = 0.5  # share of a view's pairs, below which it is no witness of a motion
_AGREEING_ROUNDS = 2
STANDING = 1e-4  # metres
_MOST_COLLAPSED = 4.0  # factor of a proposed length: lengths proposed span as much


def borne_out_elsewhere(good: Index, slight: Index) -> bool:
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
    borne_out = alone or borne_out_elsewhere(good, slight)
    return best if fits and good.sum() >= LEAST_GOOD and borne_out else None


def _told_twice(good: Index, optics: Optics) -> bool:
    """Tell whether a view, and all others together that do not see the same things, tell a motion each."""
    telling = np.flatnonzero(good >= LEAST_GOOD).tolist()
    return any(good[_apart_from(view, optics)].sum() >= LEAST_GOOD for view in telling)


def _apart_from(view: int, optics: Optics) -> list[int]:
    """Views that see other things than one of them does."""
    beside = {u for pair in optics.overlapping if view in pair for u in pair} | {view}
    return [u for u in range(optics.n_views) if u not in beside]


def _most_agreed(pairs: Pairs, proposal: Array, optics: Optics) -> tuple[Array, Pairs, Array]:
    """The proposal that most views bear out, the pairs of those that agree, and what they make of it."""
    agreeing, best = agreed(pairs, proposal, optics)
    if np.all(shares(pairs.views, pairs.fit(best, optics))[1] >= AGREEING):
        return proposal, agreeing, best
    tried = np.stack([best, *_of_all_but_one(pairs, optics)])
    most = int(np.argmax(shares(pairs.views, pairs.fit(tried, optics))[1].sum(axis=-1)))
    return (tried[most], *agreed(pairs, tried[most], optics)) if most else (proposal, agreeing, best)


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


def agreed(
    pairs: Pairs, T_a_b: Array, optics: Optics, measured: Measured | None = None
) -> tuple[Pairs, Array]:
    """Motion polished by the views that agree with it, and their pairs; all pairs without a majority."""
    agreeing, best = pairs, T_a_b
    for _ in range(_AGREEING_ROUNDS):
        against = dissenting(pairs.views, pairs.fit(best, optics), AGREEING)
        agreeing = pairs if against is None else pairs.without(against)
        best = polished(best, agreeing, optics, measured)
    return agreeing, best


def joint_motion(pairs: Pairs, proposals: dict[int, Array], optics: Optics) -> Array | None:
    """Motion of the rig that suits most views, from what single views propose."""
    best = joint_proposal(pairs, proposals, optics)
    return None if best is None else polished(best, pairs, optics)


def polished(
    T_a_b: Array, pairs: Pairs, optics: Optics, measured: Measured | None = None, only_turn: bool = False
) -> Array:
    """The motion with the least epipolar errors of all views; they move its length as far as they know it.

    What was `measured` counts for a share of the pairs.
    """
    length = max(float(np.linalg.norm(T_a_b[:3, 3])), STANDING)
    free = np.eye(3 if only_turn else 6, 6)
    times = 0 if measured is None else max(round(MEASURED_SHARE * len(pairs)), 1)

    def residuals(twists: Array) -> Array:
        T = T_a_b @ se3.exp(twists @ free)
        stretch = np.log(np.maximum(np.linalg.norm(T[..., :3, 3], axis=-1), STANDING) / length)
        told = [pairs.epipolar_errors(T, optics), _LENGTH_PRIOR * stretch[..., None]]
        told += [] if measured is None else times * [EPIPOLAR_SIGMA * measured.off(T)]
        return np.concatenate(told, axis=-1)

    def jacobian(twist: Array) -> Array:
        steps = _TWIST_STEP * np.eye(len(free))
        ahead, back = np.split(residuals(twist + np.concatenate([steps, -steps])), 2)
        return np.asarray((ahead - back).T / (2.0 * _TWIST_STEP))

    solution = least_squares(
        residuals,
        np.zeros(len(free)),
        jacobian,
        loss="cauchy",
        f_scale=EPIPOLAR_SIGMA,
        ftol=_SETTLED,
        max_nfev=30,
    )
    return T_a_b @ se3.exp(solution.x @ free)
