"""Whether the rig's file and the film belong together: the views must move as one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from facetcam.slam.config import SlamConfig
from facetcam.slam.frame import CornerFinder, Frame
from facetcam.slam.optics import Optics
from facetcam.slam.pairs import Pairs, match_corners
from facetcam.slam.proposals import view_motions
from facetcam.slam.two_frames import joint_motion

Array = NDArray[np.float64]

_STEP = 5  # frames between those compared
_MIN_PAIRS = 100  # over all views
_MIN_VIEW_PAIRS = 25
_MIN_SHARE = 0.7  # of a view's pairs that its own motion explains
_COMPARISONS = 8  # that the verdict rests on
_TRIES = 60  # comparisons, the useless ones too, after which the question stays open
_STARTS = 2  # views whose motions are tried for the whole rig
_GATE = 2.0  # px
_MISFIT = 1.3


class RigCheck:
    """Compares how well the motion of single views, and one motion of the whole rig, explain the images.

    Any view by itself is an ordinary camera, whatever the rig's file says of its place. If the file is right,
    one motion of the rig explains all views as well as a motion for each does; if not, the epipolar errors
    grow. The question stays open for a rig of one view, and while the images show too little motion.

    Parameters
    ----------
    optics : Optics
    config : SlamConfig
    corners : CornerFinder

    Attributes
    ----------
    misfit : float or None
        How much worse one motion explains the images, once it is known.
    refined : bool
        True once the rig's numbers have been refined with the map, which outdates the verdict.
    """

    def __init__(self, optics: Optics, config: SlamConfig, corners: CornerFinder) -> None:
        self._optics = optics
        self._config = config
        self._corners = corners
        self._frames = 0
        self._tries = 0
        self._last: Frame | None = None
        self._separate: list[Array] = []
        self._joint: list[Array] = []
        self.misfit: float | None = None
        self.refined = False

    @property
    def fits(self) -> bool:
        """False once the images have shown that the rig is not that of the film."""
        return self.misfit is None or self.misfit < _MISFIT

    @property
    def errors(self) -> tuple[float, float]:
        """Median epipolar error in pixels with a motion for each view, and with one for all."""
        return float(np.median(np.concatenate(self._separate))), float(np.median(np.concatenate(self._joint)))

    @property
    def complaint(self) -> str:
        """What is wrong, for people; empty while nothing is."""
        if self.fits:
            return ""
        alone, together = self.errors
        return (
            f"this rig does not fit this film: its views move by themselves to {alone:.2f} px, but as one rig"
            f" only to {together:.2f} px; calibrate the rig (facetcam calibrate), or give the film's own"
        )

    def offer(self, frame: Frame) -> None:
        """Take the next frame; every few frames it is compared with the one before."""
        open_question = self.misfit is None and self._tries < _TRIES and self._optics.n_views > 1
        if open_question and self._frames % _STEP == 0:
            if self._last is not None:
                pairs = match_corners(self._corners(self._last), self._corners(frame), self._config)
                self.compare(pairs)
            self._last = frame
        elif not open_question:
            self._last = None  # frames are large
        self._frames += 1

    def compare(self, pairs: Pairs) -> None:
        """Take the matches of two frames."""
        self._tries += 1
        errors = _epipolar_errors(pairs, self._optics)
        if errors is None:
            return
        self._separate.append(errors[0])
        self._joint.append(errors[1])
        if len(self._joint) == _COMPARISONS:
            both = zip(self._separate, self._joint)
            self.misfit = float(np.median([np.median(joint) / np.median(alone) for alone, joint in both]))


def _epipolar_errors(pairs: Pairs, optics: Optics) -> tuple[Array, Array] | None:
    """Errors in pixels of pairs that fit their own view's motion: with that motion, and with the rig's."""
    motions = view_motions(pairs, optics)
    alone = np.full(len(pairs), np.inf)
    for view, T in motions.items():
        T_rig = optics.T_rig_view[view] @ T @ optics.T_view_rig[view]
        own = pairs.views == view
        errors = np.abs(pairs.epipolar_errors(T_rig, optics)[own])
        fits = errors < _GATE
        if fits.sum() >= _MIN_VIEW_PAIRS and fits.mean() > _MIN_SHARE:
            alone[own] = errors
    fits = alone < _GATE
    if fits.sum() < _MIN_PAIRS or len(np.unique(pairs.views[fits])) < 2:
        return None
    # Wrong matches must not count against the rig.
    good = Pairs(pairs.views[fits], pairs.plane_a[fits], pairs.plane_b[fits])
    # A start from one view may end in a local minimum, which must not count against the rig either.
    fullest = np.argsort(np.bincount(pairs.views[fits]), kind="stable")[::-1][:_STARTS].tolist()
    errors = [_joint_errors(good, {view: motions[view]}, optics) for view in fullest if view in motions]
    return alone[fits], min(errors, key=lambda e: float(np.median(e)))


def _joint_errors(pairs: Pairs, proposal: dict[int, Array], optics: Optics) -> Array:
    T_a_b = joint_motion(pairs, proposal, optics)
    return np.full(len(pairs), np.inf) if T_a_b is None else np.abs(pairs.epipolar_errors(T_a_b, optics))
