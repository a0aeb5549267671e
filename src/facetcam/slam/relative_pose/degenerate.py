"""Pairs of corners that cannot tell a motion: what stands, what a turn explains, and what is too near."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from facetcam.slam.camera.optics import Optics
from facetcam.slam.relative_pose.pairs import CLEAR_PARALLAX, Pairs
from facetcam.slam.relative_pose.witnesses import shares

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_MOVING = 0.5  # share of a view's pairs, below which it seems to stand
_CLEAR_SHARE = 0.5  # of a view's pairs that must show a way, at the mean of the views
_NEAREST = 0.45  # metres of the median point


def standing_views(pairs: Pairs) -> Index:
    """Views that show no motion where at least as many do: parts of the robot, or an image that is frozen.

    Any translation explains pairs that do not move, so these views would bear out what they know nothing of.
    """
    witnesses, stand = _standing(pairs)
    return witnesses[stand] if 2 * stand.sum() <= len(stand) else witnesses[:0]


def _standing(pairs: Pairs) -> tuple[Index, NDArray[np.bool_]]:
    """Views that can tell, and which of them show no motion."""
    witnesses, share = shares(pairs.views, pairs.move())
    return witnesses, share < _MOVING


def undecided(pairs: Pairs) -> bool:
    """Tell whether as many views stand as move: images are frozen, or people walk before a rig at rest."""
    stand = _standing(pairs)[1]
    return bool(len(stand)) and bool(2 * stand.sum() == len(stand))


def on_the_spot(T_a_b: Array, optics: Optics) -> bool:
    """Tell whether views go farther by the rig's turn than by its way: mirrors put them beside its axis."""
    centres = optics.T_rig_view[:, :3, 3]
    by_turn = np.linalg.norm(centres @ T_a_b[:3, :3].T - centres, axis=1).max()
    return bool(np.linalg.norm(T_a_b[:3, 3]) < by_turn)


def shows_a_way(pairs: Pairs, optics: Optics) -> bool:
    """False for a turn on the spot, and for too small a step to tell from one."""
    share = shares(pairs.views, pairs.pure_rotation(optics)[1] > CLEAR_PARALLAX)[1]
    return bool(len(share) and share.mean() >= _CLEAR_SHARE)


def all_near(pairs: Pairs, T_a_b: Array, optics: Optics) -> bool:
    """Tell whether a motion asks for a world so close around the rig that no robot is in it."""
    distance = pairs.parallax(T_a_b, optics)[0][pairs.fit(T_a_b, optics)]
    ahead = distance[distance > 0]
    return bool(len(ahead)) and float(np.median(ahead)) < _NEAREST
