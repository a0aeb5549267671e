"""A pose that was found in the map: how much bears it out, and which of two counts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from facetcam.geometry import se3
from facetcam.slam.camera.pose import Pose
from facetcam.slam.map.measure import Measurements, Predictions
from facetcam.slam.relative_pose.witnesses import LEAST_IN_VIEW

Array = NDArray[np.float64]

_TYPICAL = 0.5  # px, by which a good measurement may be off
_SURE = 0.75  # mean of what the measurements of a pose count that none betters
_CLEAR = 0.5  # share of the predictions that a good pose confirms
_LIKELY = 0.3  # and one from afar, or with views that are dark or covered
_BY_CHANCE = 0.2  # share of the predictions that any pose may find
_FAR_BETTER = 2.0  # times the score that a look-alike elsewhere may reach
_VIEWS = 128  # at most
BESIDE = (0.2, 0.2)  # radians and metres within which two poses are one place
_SHARP = (1.0, 0.7)  # px, and the share of the measurements that fit a right pose so well


@dataclass(frozen=True, slots=True)
class Fix:
    """A pose, the map points expected with it, and the measurements that agree."""

    pose: Pose
    predictions: Predictions
    seen: Measurements

    @property
    def T_world_rig(self) -> Array:
        """Pose (4, 4) of the rig."""
        return self.pose.T_world_rig

    @property
    def clear(self) -> bool:
        """Tell whether most of what was expected is there: look-alikes rarely agree so far."""
        return len(self.seen) >= _CLEAR * len(self.predictions)

    @property
    def score(self) -> float:
        """Measurements, each counted by how well it agrees."""
        return float(np.sum(1.0 / (1.0 + (self.pose.residuals / _TYPICAL) ** 2)))

    @property
    def sure(self) -> bool:
        """Tell whether no other pose can do better: what agrees with a clear one does so closely."""
        return self.clear and self.score >= _SURE * len(self.seen)

    @property
    def likely(self) -> bool:
        """Tell whether a good part of what was expected is there."""
        return len(self.seen) >= _LIKELY * len(self.predictions)

    @property
    def borne_out(self) -> bool:
        """Tell whether anything bears it out: what is found in all views, or in one, or how well that agrees.

        By chance alone some patches of many agree with any pose.
        """
        return bool(self.witnesses or len(self.seen) >= _BY_CHANCE * len(self.predictions) or self.sharp)

    @property
    def witnesses(self) -> int:
        """Count the views in which enough of what was expected is there."""
        seen, expected = (np.bincount(rows.view, minlength=_VIEWS) for rows in (self.seen, self.predictions))
        return int(np.count_nonzero((seen >= LEAST_IN_VIEW) & (seen >= _LIKELY * expected)))

    @property
    def sharp(self) -> bool:
        """Tell whether the measurements agree far better than the gate asks: chance spreads them over it."""
        width, share = _SHARP
        return int(np.count_nonzero(self.pose.residuals < width)) >= share * len(self.seen)


def likelier(near: Fix | None, other: Fix | None) -> Fix | None:
    """The better one, but for look-alikes elsewhere: a likely pose where the rig should be needs no other.

    Unless that one is clear, and far better: then the rig was not going where it seemed to.
    """
    if near is None or other is None or not near.likely or beside(near.T_world_rig, other.T_world_rig):
        return better(near, other)
    far_better = other.clear and not near.clear and other.score > _FAR_BETTER * near.score
    return other if far_better else near


def beside(a: Array, b: Array, within: tuple[float, float] = BESIDE) -> bool:
    """Tell whether two poses (4, 4) are one, `within` radians and metres."""
    turn, way = np.linalg.norm(se3.log(se3.inverse(a) @ b).reshape(2, 3), axis=1)
    return bool(turn < within[0] and way < within[1])


def better(a: Fix | None, b: Fix | None) -> Fix | None:
    """The one with which more agrees, but for look-alikes, which lack most of what would have to be there."""
    return max(a, b, key=lambda fix: (False, 0) if fix is None else (fix.likely, fix.score))
