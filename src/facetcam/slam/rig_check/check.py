"""Whether the rig's file and the film belong together: the views must move as one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from facetcam.geometry import se3
from facetcam.slam.camera.corner_finder import CornerFinder
from facetcam.slam.camera.frame import Frame
from facetcam.slam.camera.optics import Optics
from facetcam.slam.config import SlamConfig
from facetcam.slam.relative_pose.pairs import Pairs, match_corners
from facetcam.slam.relative_pose.proposals import view_motions
from facetcam.slam.relative_pose.two_frames import joint_motion
from facetcam.slam.rig_check.audit import RigAudit
from facetcam.slam.rig_check.refinement import RigRefinement

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
_FIT = 1.15
_OWN_TURN = 0.01  # radians by which a view that moves by itself turns more or less than the rig


class RigCheck:
    """Compares how well the motion of single views, and one motion of the whole rig, explain the images.

    Any view by itself is an ordinary camera, whatever the rig's file says of its place. If the file is right,
    one motion of the rig explains all views as well as a motion for each does; if not, the epipolar errors
    grow. The question stays open for a rig of one view, and while the images show too little motion.

    Where all but one view agree, a mirror stands otherwise, or something moves before that view, or sticks to
    it. A mirror turns what it shows by as much as the rig turns, whatever its file says of it; a person does
    not.

    Parameters
    ----------
    optics : Optics
    config : SlamConfig
    corners : CornerFinder

    Attributes
    ----------
    misfit : float or None
        How much worse one motion explains the images, once it is known.
    refinement : RigRefinement or None
        How the rig's numbers were refined with the map, which outdates the verdict.
    odd_view : str
        The view without which all others fit; empty where there is none.
    moves_by_itself : bool
        True where something before that view explains it, and the rig need not be wrong.
    audit : RigAudit or None
        What the map says of the rig, as long as it is sure of its scale.
    """

    def __init__(self, optics: Optics, config: SlamConfig, corners: CornerFinder) -> None:
        self._optics = optics
        self._config = config
        self._corners = corners
        self._frames = 0
        self._tries = 0
        self._last: Frame | None = None
        self._comparisons: list[Comparison] = []
        self.misfit: float | None = None
        self.refinement: RigRefinement | None = None
        self.odd_view = ""
        self.moves_by_itself = False
        self.audit: RigAudit | None = None

    @property
    def fits(self) -> bool:
        """False once the images have shown that the rig is not that of the film."""
        if self.refinement is not None:
            return not self.refinement.complaint
        return self.moves_as_one and not (self.audit and self.audit.denies)

    @property
    def moves_as_one(self) -> bool:
        """False once no motion of the rig explains all views."""
        return self.misfit is None or self.misfit < _MISFIT or self.moves_by_itself

    @property
    def errors(self) -> tuple[float, float]:
        """Median epipolar error in pixels with a motion for each view, and with one for all."""
        alone, joint = (
            np.concatenate([getattr(c, kind) for c in self._comparisons]) for kind in ("alone", "joint")
        )
        return float(np.median(alone)), float(np.median(joint))

    @property
    def complaint(self) -> str:
        """What is wrong, for people; empty while nothing is."""
        if self.refinement is not None and self.refinement.complaint:
            return self.refinement.complaint
        if self.moves_as_one:
            return self.audit.complaint if self.audit and self.refinement is None else ""
        alone, together = self.errors
        without = f", though well without {self.odd_view}" if self.odd_view else ""
        return (
            f"this rig does not fit this film: its views move by themselves to {alone:.2f} px, but as one rig"
            f" only to {together:.2f} px{without}; calibrate the rig (facetcam calibrate), or give the film's"
            " own"
        )

    @property
    def remark(self) -> str:
        """What a view shows that is not the rig's fault, for people; empty where nothing is."""
        if not self.moves_by_itself:
            return ""
        return f"the view {self.odd_view} moves by itself: someone walks before it, or it stands still"

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
        comparison = compared(pairs, self._optics)
        if comparison is None:
            return
        self._comparisons.append(comparison)
        if len(self._comparisons) == _COMPARISONS:
            self.misfit = _misfit(self._comparisons)
            if self.misfit >= _MISFIT:
                self._find_odd_view()

    def _find_odd_view(self) -> None:
        """Look for a single view that is to blame, and whether it turns as the rig does."""
        for view, name in enumerate(self._optics.names):
            both = [(c, c.without(view, self._optics)) for c in self._comparisons if view in c.motions]
            known = [(_turn(whole.motions[view]), rest) for whole, rest in both if rest is not None]
            if 2 * len(known) > _COMPARISONS and _misfit([rest for _, rest in known]) < _FIT:
                off = [abs(turn - _turn(rest.T_a_b)) for turn, rest in known]
                self.odd_view, self.moves_by_itself = name, float(np.median(off)) > _OWN_TURN


@dataclass(frozen=True, eq=False, slots=True)
class Comparison:
    """Two frames: the pairs that fit the motion of their own view, and how well one motion of all does.

    Attributes
    ----------
    pairs : Pairs
    motions : dict of int to (4, 4) array
        Of the pinhole of each view that counts.
    T_a_b : (4, 4) array
        Of the rig, as it suits all of them.
    alone, joint : (N,) arrays
        Errors in pixels with the one and the other.
    """

    pairs: Pairs
    motions: dict[int, Array]
    T_a_b: Array
    alone: Array
    joint: Array

    @classmethod
    def of(cls, pairs: Pairs, motions: dict[int, Array], alone: Array, optics: Optics) -> Self | None:
        """Compare them; None where fewer than two views have pairs."""
        counts = np.bincount(pairs.views, minlength=optics.n_views)
        if np.count_nonzero(counts) < 2:
            return None
        # A start from one view may end in a local minimum, which must not count against the rig.
        starts = np.argsort(counts, kind="stable")[::-1][:_STARTS].tolist()
        tried = [joint_motion(pairs, {v: motions[v]}, optics) for v in starts if v in motions]
        errors = [(T, np.abs(pairs.epipolar_errors(T, optics))) for T in tried if T is not None]
        nothing = (np.eye(4), np.full(len(pairs), np.inf))
        T_a_b, joint = min(errors, key=lambda e: float(np.median(e[1])), default=nothing)
        return cls(pairs, motions, T_a_b, alone, joint)

    def without(self, view: int, optics: Optics) -> Comparison | None:
        """The same frames without one view; None where fewer than two others have pairs."""
        others = {v: T for v, T in self.motions.items() if v != view}
        rows = self.pairs.views != view
        return Comparison.of(self.pairs.without(np.array([view])), others, self.alone[rows], optics)


def compared(pairs: Pairs, optics: Optics) -> Comparison | None:
    """Compare two frames by those matches that fit their own view's motion; None if they are too few."""
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
    if fits.sum() < _MIN_PAIRS:
        return None
    # Wrong matches must not count against the rig.
    good = Pairs(pairs.views[fits], pairs.plane_a[fits], pairs.plane_b[fits])
    counted = {v: T for v, T in motions.items() if np.any(good.views == v)}
    return Comparison.of(good, counted, alone[fits], optics)


def _misfit(comparisons: list[Comparison]) -> float:
    return float(np.median([np.median(c.joint) / np.median(c.alone) for c in comparisons]))


def _turn(T: Array) -> float:
    """Angle in radians; it is the same for a view and for the rig, however the view stands in the rig."""
    return float(np.linalg.norm(se3.log(T)[:3]))
