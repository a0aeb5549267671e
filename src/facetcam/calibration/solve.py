"""Solve a rig from sightings of boards: lens, mirrors, boards and rig poses together."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from facetcam.calibration.assignment import assign
from facetcam.calibration.boards import BoardSet
from facetcam.calibration.covariance import knowledge, parameters_of, rig_covariance, with_sigmas
from facetcam.calibration.creep import crept
from facetcam.calibration.evidence import corner_noise, is_mended, middle_error
from facetcam.calibration.fit import Fit, Tolerance, begin
from facetcam.calibration.guidance import LookAgain, looked_again
from facetcam.calibration.intruders import without_intruders
from facetcam.calibration.observability import unknowns
from facetcam.calibration.rejection import (
    believed,
    findings_of,
    noise_of,
    reviewed,
    spread_of,
    without_place,
)
from facetcam.calibration.rereading import reread
from facetcam.calibration.result import Calibration, Finding, FittedSighting
from facetcam.calibration.scale import out_of_scale
from facetcam.calibration.sightings import Sighting
from facetcam.calibration.small_moves import put_back
from facetcam.calibration.start import is_mirrored, poses_apart, usable
from facetcam.errors import FacetcamError
from facetcam.geometry import se3
from facetcam.rig import NO_VIEW, Rig

Array = NDArray[np.float64]
Progress = Callable[[int, int | None], None]

_LOSSES = (100.0, 10.0, 2.0)  # pixels, coarse to fine
_STEPS = 6
_UNKNOWN = 100.0  # times its tolerance a length is not known at all


def solve(
    rig: Rig,
    boards: BoardSet,
    sightings: Sequence[Sighting],
    look_again: LookAgain | None = None,
    progress: Progress | None = None,
    tolerance: Tolerance | None = None,
) -> Calibration:
    """Solve for the rig as built.

    Parameters
    ----------
    rig : Rig
        As drawn; good to about 3 degrees and 5 mm a mirror and 10 % in focal length.
    boards : BoardSet
    sightings : sequence of Sighting
        From all photos; those without a view are assigned to one.
    look_again : callable, optional
        `(photo, predicted (N, 2), square_px (N,)) -> (pixels (N, 2), accepted (N,))`: looks for corners where
        the first solve predicts them.
    progress : callable, optional
        Called with steps done and steps in all.
    tolerance : Tolerance, optional
        Of the drawing.

    Raises
    ------
    FacetcamError
        If nothing can be solved: too few sightings, or none that fit a view of the rig.
    """
    began = time.perf_counter()
    done = _Steps(progress)
    tolerance = tolerance or Tolerance()
    fit = started(rig, boards, sightings, tolerance)
    lost = without_place(fit, boards, sightings)
    done()
    fit = _coarse(fit)
    if out_of_scale(fit):  # squares of a wrong size? What the drawing says of lengths would bend the rig.
        lengths_unknown = replace(tolerance, shift=_UNKNOWN * tolerance.shift)
        other = _coarse(started(rig, boards, sightings, lengths_unknown))
        fit = other if is_mended(middle_error(fit), middle_error(other), corner_noise(other)) else fit
    fit = reread(fit, boards, sightings)
    done()
    fit, intruders = without_intruders(fit, boards)
    here = set(fit.photos)
    fit, strange = reviewed(fit, boards, [s for s in sightings if s.photo in here])
    fit, intruders = put_back(fit, boards, intruders)
    done()
    fit = settled(fit)
    done()
    if look_again is not None:
        fit = settled(looked_again(fit, boards, look_again))
    done()
    # Another lens shifts views as creep does.
    creep = () if any(f.kind == "focus" for f in intruders) else crept(fit)
    findings = lost + intruders + findings_of(strange, boards) + creep
    result = _calibration(fit, boards, findings, noise_of(fit), began)
    done()
    return result


def started(rig: Rig, boards: BoardSet, sightings: Sequence[Sighting], tolerance: Tolerance) -> Fit:
    """The joint problem with every sighting in its view, boards and rig roughly placed."""
    whole = [s for s in sightings if usable(s, boards)]
    if not whole:
        raise FacetcamError(
            f"calibration: none of {len(sightings)} sightings shows four corners that span an area;"
            " take photos in which more of a board is seen"
        )
    camera, T_image_board, _ = poses_apart(rig.camera, tolerance.focal, whole, boards)
    views = list(rig.views)
    assignment = assign(replace(rig, camera=camera), views, boards, whole, T_image_board)
    if np.all(assignment.view == NO_VIEW):
        raise FacetcamError(
            "calibration: no board stands where a view of the rig could show it;"
            f" check that the rig file belongs to these photos{_turned_over(rig, whole, boards)}"
        )
    return begin(rig, camera, boards, views, assignment, tolerance)


def _turned_over(rig: Rig, sightings: Sequence[Sighting], boards: BoardSet) -> str:
    """That all boards are seen mirrored where no view mirrors, or the other way round."""
    seen = {is_mirrored(s, boards) if s.mirrored is None else s.mirrored for s in sightings}
    if seen & {rig.is_flipped(view) for view in rig.views}:
        return ""
    found, drawn = ("mirror images", "an even") if True in seen else ("no mirror images", "an odd")
    return (
        f": it shows boards in {drawn} number of mirrors, the photos show {found};"
        " were they flipped by a program, or is a mirror missing in the file?"
    )


def _coarse(fit: Fit) -> Fit:
    for loss in _LOSSES[:2]:
        fit = fit.solved(loss, 40, fit.lens_held).solved(loss, 40)
    return fit


def settled(fit: Fit) -> Fit:
    """Reject wrong corners and solve for the rest."""
    fit = fit.solved(_LOSSES[2])
    for _ in range(2):
        sigma = noise_of(fit)
        fit = replace(fit, looks=replace(fit.looks, spread=spread_of(fit, sigma)))
        fit = replace(fit, kept=believed(fit, sigma), prior=replace(fit.prior, noise=sigma)).solved(None)
    return fit


def _calibration(
    fit: Fit, boards: BoardSet, findings: tuple[Finding, ...], noise: float, began: float
) -> Calibration:
    known = knowledge(fit, noise)
    parameters = parameters_of(fit, known)
    predicted = fit.state.predict(fit.looks)
    fitted = tuple(
        FittedSighting(s, predicted[a:b], fit.kept[a:b]) for s, (a, b) in zip(fit.sightings, fit.looks.bounds)
    )
    state, worlds = fit.state, fit.places != (-1,)
    poses = {
        (s.photo, s.board): state.T_rig_station[p] @ state.T_station_board[b]
        for s, b, p in zip(fit.sightings, fit.looks.board, fit.looks.station)
    }
    return Calibration(
        rig=replace(
            with_sigmas(fit.rig, parameters),
            covariance=rig_covariance(fit, known),
            solved_from=_origin(fit, boards),
        ),
        nominal=fit.nominal,
        boards=boards,
        T_rig_board=poses,
        T_world_rig={
            photo: se3.inverse(T) for (photo, _), T in zip(fit.stations, state.T_rig_station) if worlds
        },
        T_world_board={
            int(b): state.T_station_board[b]
            for b in range(len(boards.boards))
            if worlds and b in fit.looks.board
        },
        sightings=fitted,
        parameters=parameters,
        noise=noise,
        alike=float(np.sqrt(known.factor)),
        unobservable=unknowns(fit, known, boards),
        findings=findings,
        seconds=time.perf_counter() - began,
        fit=fit,
    )


def _origin(fit: Fit, boards: BoardSet) -> str:
    """Digest of all that the solve went on."""
    content = hashlib.sha256(f"{fit.nominal.digest} {boards.digest} {boards.fixed}".encode())
    for s in fit.sightings:
        content.update(f"{s.photo} {s.board} {s.view}".encode())
        content.update(s.corners.astype("<i8").tobytes() + s.pixels.astype("<f8").tobytes())
    return content.hexdigest()


class _Steps:
    """Counts the steps of a solve."""

    def __init__(self, progress: Progress | None) -> None:
        self._progress, self._done = progress, 0

    def __call__(self) -> None:
        self._done += 1
        if self._progress is not None:
            self._progress(self._done, _STEPS)
