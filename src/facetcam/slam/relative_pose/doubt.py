"""Views that lie: what is frozen or full of people contradicts the motion that the other views show."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from facetcam.geometry import se3
from facetcam.slam.camera.optics import Optics
from facetcam.slam.relative_pose.confirmed_motion import much_alike
from facetcam.slam.relative_pose.pairs import Pairs
from facetcam.slam.relative_pose.proposals import view_motions
from facetcam.slam.relative_pose.two_frames import joint_motion, polished
from facetcam.slam.relative_pose.witnesses import shares

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_AGREEING = 0.5  # share of a view's pairs, below which it contradicts a motion
_STANDING = 0.5  # and above which it stands where the turn alone should have moved it
_SURE = 0.8  # and above which it agrees with it beyond doubt
_CLEAR = 0.4  # and above which it bears one out that refutes another
_BETTER = 0.2  # by which another motion's share is larger
_MOST_ASTRAY = 0.1  # radians
_MANY = 3  # views whose false pairs do not agree on one motion by chance
_ALIKE = 0.03  # radians between the turns, and between the ways, of motions that may differ in length alone


def views_aside(pairs: Pairs, T_a_b: Array, optics: Optics) -> Index:
    """Views that show another motion, or stand in spite of this one; none where most do.

    A view whose pairs fit no motion is no liar: in poor light, or on a rough way, most pairs may be false.
    """
    witnesses, fitting = shares(pairs.views, pairs.fit(T_a_b, optics))
    standing = shares(pairs.views, pairs.stand(T_a_b, optics))[1]
    own = [_own_share(pairs, v, optics) if fits < _AGREEING else 0.0 for v, fits in zip(witnesses, fitting)]
    lying = (standing > _STANDING) | (np.array(own) > np.maximum(fitting + _BETTER, _AGREEING))
    aside = witnesses[lying]
    return aside if 2 * len(aside) <= len(witnesses) else aside[:0]


def _own_share(pairs: Pairs, view: int, optics: Optics) -> float:
    """Share of a view's pairs that fit the motion which they show by themselves."""
    own = pairs.without(np.setdiff1d(pairs.views, view))
    T = view_motions(own, optics).get(view)
    if T is None:
        return 0.0
    return float(own.fit(optics.T_rig_view[view] @ T @ optics.T_view_rig[view], optics).mean())


def _on_the_same_way(T: Array, T_a_b: Array) -> bool:
    """Tell whether motions differ in little but their length, which a young map may yet get wrong."""
    turn = np.linalg.norm(se3.log(se3.inverse(T_a_b) @ T)[:3])
    a, b = T[:3, 3], T_a_b[:3, 3]
    aside = np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)
    return bool(turn < _ALIKE and aside < _ALIKE)


def is_denied(pairs: Pairs, T_a_b: Array, optics: Optics, wheels: Array | None = None) -> bool:
    """Tell whether a motion along another way explains what more views show, and far better, than this.

    Wheels that went another way are a witness beside the views.
    """
    witnesses, fitting = shares(pairs.views, pairs.fit(T_a_b, optics))
    another = _of_doubters(pairs, witnesses[fitting < _SURE], T_a_b, optics)
    if another is not None and _speaks_against(T_a_b, another, fitting, pairs, optics):
        return True
    against = witnesses[fitting < _AGREEING]
    if wheels is None or not len(against) or _on_the_same_way(wheels, T_a_b):
        return False
    another = polished(wheels, pairs.without(np.setdiff1d(witnesses, against)), optics)
    theirs = much_alike(another, wheels)
    return theirs and _speaks_against(T_a_b, another, fitting, pairs, optics, besides=1)


def _speaks_against(
    T_a_b: Array, another: Array, fitting: Array, pairs: Pairs, optics: Optics, besides: int = 0
) -> bool:
    """Tell whether two witnesses or more, `besides` of which are no views, clearly prefer another motion.

    Of three views or more half of the pairs are enough: false ones do not agree on one motion by chance.
    """
    if _on_the_same_way(another, T_a_b):
        return False
    otherwise = shares(pairs.views, pairs.fit(another, optics))[1]
    against, in_favour = otherwise > fitting + _BETTER, fitting > otherwise + _BETTER
    clearly = bool(np.all(otherwise[against] > (_SURE if against.sum() < _MANY else _AGREEING)))
    return clearly and against.sum() + besides >= max(2, in_favour.sum() + 1)


def refuting_motion(pairs: Pairs, T_a_b: Array, optics: Optics) -> Array | None:
    """The motion that several views show where they contradict this one; None where they do not.

    The map must be grown: its lengths are right, so small turns astray count, too. What turns quite otherwise
    is a pattern that repeats, not what a bent map does to a pose; unless one view alone bears the pose out
    and three agree on the other: then people in that view have led the map astray.
    """
    witnesses, fitting = shares(pairs.views, pairs.fit(T_a_b, optics))
    another = _of_doubters(pairs, witnesses[fitting < _AGREEING], T_a_b, optics)
    if another is None:
        return None
    quite_otherwise = np.linalg.norm(se3.log(se3.inverse(T_a_b) @ another)[:3]) > _MOST_ASTRAY
    otherwise = shares(pairs.views, pairs.fit(another, optics))[1]
    prefer, in_favour = otherwise > np.maximum(fitting + _BETTER, _CLEAR), fitting > otherwise + _BETTER
    if quite_otherwise:
        return another if prefer.sum() >= _MANY and in_favour.sum() == 1 else None
    against = prefer & (fitting < _AGREEING)
    return another if against.sum() >= 2 and against.sum() > in_favour.sum() else None


def _of_doubters(pairs: Pairs, doubters: Index, T_a_b: Array, optics: Optics) -> Array | None:
    """The motion that suits most of the views that doubt one, from what they propose or from that one."""
    if len(doubters) < 2:
        return None
    own = pairs.without(np.setdiff1d(np.unique(pairs.views), doubters))
    tried = [joint_motion(own, view_motions(own, optics), optics), polished(T_a_b, own, optics)]
    motions = [T for T in tried if T is not None]
    share = [shares(own.views, own.fit(T, optics))[1].sum() for T in motions]
    return motions[int(np.argmax(share))]
