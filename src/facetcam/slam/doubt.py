"""Views that lie: what is frozen or full of people contradicts the motion that the other views show."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from facetcam.slam.optics import Optics
from facetcam.slam.pairs import Pairs
from facetcam.slam.two_frames import joint_motion, view_motions
from facetcam.slam.witnesses import shares

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_AGREEING = 0.5  # share of a view's pairs, below which it contradicts a motion
_STANDING = 0.5  # and above which it stands where the turn alone should have moved it
_ANOTHER = 0.8  # share of their pairs by which views agree on another motion


def views_aside(pairs: Pairs, T_a_b: Array, optics: Optics) -> Index:
    """Views that contradict a motion, or stand in spite of it, unless all do."""
    witnesses, fitting = shares(pairs.views, pairs.fit(T_a_b, optics))
    standing = shares(pairs.views, pairs.stand(T_a_b, optics))[1]
    aside = witnesses[(fitting < _AGREEING) | (standing > _STANDING)]
    return aside if len(aside) < len(witnesses) else aside[:0]


def is_denied(pairs: Pairs, T_a_b: Array, optics: Optics) -> bool:
    """Tell whether most views contradict a motion and agree on another one."""
    witnesses, fitting = shares(pairs.views, pairs.fit(T_a_b, optics))
    against = witnesses[fitting < _AGREEING]
    if len(against) < 2 or 2 * len(against) <= len(witnesses):
        return False
    others = pairs.without(np.setdiff1d(np.unique(pairs.views), against))
    another = joint_motion(others, view_motions(others, optics), optics)
    return another is not None and bool(
        np.all(shares(others.views, others.fit(another, optics))[1] > _ANOTHER)
    )
