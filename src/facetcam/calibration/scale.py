"""Whether the squares have the size that is said: the views then stand as far apart as drawn."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from facetcam.calibration.boards import BoardSet
from facetcam.calibration.fit import Fit
from facetcam.calibration.result import Finding
from facetcam.errors import FacetcamError

_FEWEST = 3  # distances that tell a common scale from one mirror that is off
_LEAST = 0.02  # of a difference that is worth a word
_NEAR = 1.5  # factor up to which the drawing is near enough to tell more than about how large they are
_ALIKE = 8.0  # times the distances' own scatter: mirrors may be off each in its own way


def wrong_scale(fit: Fit, boards: BoardSet) -> tuple[Finding, ...]:
    """Tell if all views stand farther apart than drawn, or nearer, by the same share.

    Squares of a wrong size scale the whole rig and leave no residual; errors of single mirrors change the
    distances between the views' centres each in its own way. A common error of all mirrors looks the same.

    Parameters
    ----------
    fit : Fit
        Solved.
    boards : BoardSet

    Returns
    -------
    tuple of Finding
        One at most; none where fewer than three distances were measured.
    """
    ratios = _ratios(fit)
    scale = float(np.median(ratios)) if len(ratios) else 1.0
    scatter = 1.4826 * float(np.median(np.abs(ratios - scale))) if len(ratios) else 0.0
    if abs(scale - 1.0) < max(_LEAST, _ALIKE * scatter):
        return ()
    size = 1e3 * boards.boards[0].square
    what = f"the views stand {scale:.3f} times as far apart as drawn, all alike"
    near = 1 / _NEAR < scale < _NEAR
    fits = (f"{size / scale:.1f}" if near else f"about {size / scale:.2g}") + " mm would fit the drawing"
    advice = f"measure the boards' squares (said to be {size:.1f} mm; {fits}) and the drawing's sizes"
    return (Finding("scale", f"{what}: {advice}"),)


def out_of_scale(fit: Fit) -> bool:
    """Tell whether all views stand much farther apart than drawn, or much nearer."""
    ratios = _ratios(fit)
    return bool(len(ratios) and (ratios.min() > _NEAR or ratios.max() < 1 / _NEAR))


def refuse_far_scale(fit: Fit, boards: BoardSet) -> None:
    """Refuse a rig far from the size drawn: none is built so, and every map by it would be as far off.

    Raises
    ------
    FacetcamError
        With the size of the squares that would fit.
    """
    found = wrong_scale(fit, boards)
    if found and out_of_scale(fit):
        raise FacetcamError(f"no rig is written: {found[0].text}, and correct boards.yaml or the drawing")


def _ratios(fit: Fit) -> NDArray[np.float64]:
    """Of the distances (D,) between views as built and as drawn; none where they are few or too unequal."""
    views = [view for view in fit.nominal.views if any(s.view == view for s in fit.sightings)]
    drawn, built = (
        np.array(
            [
                np.linalg.norm(rig.T_rig_image(a)[:3, 3] - rig.T_rig_image(b)[:3, 3])
                for a, b in combinations(views, 2)
            ]
        )
        for rig in (fit.nominal, fit.rig)
    )
    if len(drawn) < _FEWEST or drawn.min() < 0.1 * drawn.max():
        return np.empty(0)
    return np.asarray(built / drawn)
