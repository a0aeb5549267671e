"""What a calibration gives: the rig as built, what fitted and what did not, and what stays unknown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from facetcam.calibration.boards import BoardSet
from facetcam.calibration.sightings import Sighting
from facetcam.rig import Rig

Array = NDArray[np.float64]

_MOST_NAMED = 12  # photos in a sentence


@dataclass(frozen=True, eq=False)
class FittedSighting:
    """A sighting with its view, and how the solved rig explains it.

    Attributes
    ----------
    sighting : Sighting
        All its corners, `view` set.
    predicted : (N, 2) array
        Where the solved rig puts the corners, in raw-frame pixels.
    kept : (N,) bool array
        False for corners that were rejected: wrong, beside a seam, or beyond what noise explains.
    """

    sighting: Sighting
    predicted: Array
    kept: NDArray[np.bool_]

    @property
    def residuals(self) -> Array:
        """Seen minus predicted, (N, 2) pixels."""
        return self.sighting.pixels - self.predicted


@dataclass(frozen=True, eq=False)
class Parameters:
    """The free numbers of the rig, with the covariance that the photos give them.

    Attributes
    ----------
    names : tuple of str
        `fx`, `k1`, `left: tilt about u`, ... in the order of the covariance.
    units : tuple of str
        `px`, `` (none), `deg` or `mm`: the unit of `value` and `sigma`.
    value : (P,) array
        Solved value; of a mirror's plane, how far it stands from the drawing.
    sigma : (P,) array
        One standard deviation; NaN where the photos do not determine it (see `Calibration.unobservable`).
    covariance : (P, P) array
        In SI units (pixels, radians, metres). Directions that the photos leave open have the drawing's
        tolerance.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    value: Array
    sigma: Array
    covariance: Array


@dataclass(frozen=True)
class Unknown:
    """One direction that the photos do not determine, in words.

    Attributes
    ----------
    what : str
        A sentence: what cannot be known, and why.
    advice : str
        Which photo to add; empty where none helps.
    mirrors : tuple of str
        The mirrors it is about.
    harmless : bool
        True where it changes no view against another, so that nothing measured with the rig depends on it.
    """

    what: str
    advice: str = ""
    mirrors: tuple[str, ...] = ()
    harmless: bool = False


@dataclass(frozen=True)
class Finding:
    """Something wrong with the photos or boards that the solve met and worked round.

    Attributes
    ----------
    kind : str
        `moved board`, `other camera`, `sighting rejected`, `crept`, `photo left out`, `view unseen`
        or `scale`.
    words : str
        A sentence for the user; `{photos}` stands for the photos.
    photos : tuple of int
        Indices of the photos concerned.
    """

    kind: str
    words: str
    photos: tuple[int, ...] = ()

    @property
    def text(self) -> str:
        """The sentence, photos by their indices."""
        return self.told([])

    def told(self, names: Sequence[str]) -> str:
        """The sentence, photos by these names; those beyond the list by their indices."""
        named = [names[p] if p < len(names) else str(p) for p in self.photos]
        more = f" and {len(named) - _MOST_NAMED} more" if len(named) > _MOST_NAMED else ""
        return self.words.replace("{photos}", ", ".join(named[:_MOST_NAMED]) + more)


@dataclass(frozen=True, eq=False)
class Calibration:
    """A solved rig with all that its report needs.

    Attributes
    ----------
    rig : Rig
        As built.
    nominal : Rig
        As drawn: where the solve began.
    boards : BoardSet
    T_rig_board : mapping of (photo, board) to (4, 4) array
        Pose of every board that was seen in a photo, in the rig frame of that photo.
    T_world_rig : mapping of photo to (4, 4) array
        Rig poses in the frame of the first board; empty when the boards move against each other.
    T_world_board : mapping of board to (4, 4) array
        Empty when the boards move against each other.
    sightings : tuple of FittedSighting
    parameters : Parameters
    noise : float
        Standard deviation of a corner coordinate in a usual sighting, in pixels, as the residuals show it.
    alike : float
        Sigmas against those of corners that err independently: above 1 where corners of a photo err alike.
    unobservable : tuple of Unknown
    findings : tuple of Finding
    seconds : float
        Time of the solve.
    fit : Fit
        The problem and its state (`facetcam.calibration.fit`), from which `validate` goes on.
    """

    rig: Rig
    nominal: Rig
    boards: BoardSet
    T_rig_board: Mapping[tuple[int, int], Array]
    T_world_rig: Mapping[int, Array]
    T_world_board: Mapping[int, Array]
    sightings: tuple[FittedSighting, ...]
    parameters: Parameters
    noise: float
    alike: float = 1.0
    unobservable: tuple[Unknown, ...] = ()
    findings: tuple[Finding, ...] = ()
    seconds: float = 0.0
    fit: Any = field(default=None, repr=False)

    def rms(self, kept_only: bool = True) -> float:
        """Root mean square length of the residual vectors in pixels, of the corners kept or of all."""
        squares = [
            np.sum(f.residuals[f.kept if kept_only else slice(None)] ** 2, axis=1) for f in self.sightings
        ]
        joined = np.concatenate([*squares, np.empty(0)])
        return float(np.sqrt(joined.mean())) if len(joined) else float("nan")

    @property
    def rms_of_noise(self) -> float:
        """Root mean square length in pixels that noise alone gives the residuals of the corners kept."""
        spread = self.fit.looks.noise[self.fit.kept] if self.fit is not None else np.ones(1)
        return float(np.sqrt(2.0 * np.mean(spread**2)) * self.noise)


@dataclass(frozen=True)
class Preflight:
    """What photos can determine, told before the solve.

    Attributes
    ----------
    enough : bool
        Whether all that matters can be determined.
    unobservable : tuple of Unknown
    advice : tuple of str
        Photos to add, most useful first.
    sightings : mapping of view to int
        Sightings a view.
    expected : mapping of str to str
        Expected sigma in words, by parameter group.
    findings : tuple of Finding
    """

    enough: bool
    unobservable: tuple[Unknown, ...]
    advice: tuple[str, ...]
    sightings: Mapping[str, int]
    expected: Mapping[str, str]
    findings: tuple[Finding, ...] = ()
