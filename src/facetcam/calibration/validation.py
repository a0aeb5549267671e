"""How good a calibration is: photos held out, halves compared, mirrors tested for flatness."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from facetcam.calibration.across_views import LEAST_CORNERS, AcrossViews, across_views
from facetcam.calibration.covariance import knowledge, shared_covariance
from facetcam.calibration.difference import projection_difference, room_points
from facetcam.calibration.fit import Fit
from facetcam.calibration.flatness import flatness
from facetcam.calibration.quality import MirrorDeviation, Validation
from facetcam.calibration.result import Calibration
from facetcam.calibration.uncertainty import uncertainty_maps

Array = NDArray[np.float64]
Progress = Callable[[int, int | None], None]

FOLDS = 5
_LEAST_PHOTOS = 6  # from which halves are compared
_POINTS = 300  # a view, by which halves are compared


def validate(calibration: Calibration, progress: Progress | None = None, folds: int = FOLDS) -> Validation:
    """Judge a calibration by photos that it has not seen, and by models that it has not used.

    Parameters
    ----------
    progress : callable, optional
        Called with steps done and steps in all.
    folds : int
        Parts into which the photos are cut; each is held out in turn.
    """
    fit: Fit = calibration.fit
    folds = min(folds, len(fit.photos))
    total, held = folds + 3, _HeldOut({}, {})
    for k in range(folds if folds > 1 else 0):
        held = held.joined(_held_out(fit, fit.photos[k::folds], calibration.noise))
        _tell(progress, k + 1, total)
    across = AcrossViews.joined(list(held.across.values()))
    rms, by_view = _split_half(fit)
    _tell(progress, folds + 1, total)
    flat = flatness(fit, calibration.noise)
    _tell(progress, folds + 2, total)
    known = knowledge(fit, calibration.noise)
    maps = uncertainty_maps(fit, known, _usual_depth(fit))
    _tell(progress, total, total)
    return Validation(
        held_out_rms=_rms(held.own.values()),
        held_out={photo: _rms([r]) for photo, r in sorted(held.own.items())},
        cross_view_rms=_rms([across.residuals]),
        cross_view_expected=across.expected_rms,
        cross_view={photo: _rms([a.residuals]) for photo, a in sorted(held.across.items())},
        split_half_rms=rms,
        split_half=by_view,
        flatness=flat,
        deviations=deviations_of(calibration),
        maps=maps,
    )


@dataclass(frozen=True, eq=False)
class _HeldOut:
    """Residuals (N, 2) a photo, the rig pose from all its views; and from one view, judged in the others."""

    own: dict[int, Array]
    across: dict[int, AcrossViews]

    def joined(self, other: _HeldOut) -> _HeldOut:
        return _HeldOut(self.own | other.own, self.across | other.across)


def _held_out(fit: Fit, photos: list[int], noise: float) -> _HeldOut:
    """Solve without some photos, then let only their rig poses move."""
    trained = fit.of_photos([p for p in fit.photos if p not in photos]).solved(None, 30)
    shared = shared_covariance(trained, noise)
    seen = set(trained.looks.board.tolist())
    own, across = {}, {}
    for photo in photos:
        part = fit.of_photos([photo])
        known = np.isin(part.looks.board[part.looks.sighting], list(seen))
        part = replace(part, kept=part.kept & known)
        state = replace(trained.state, T_rig_station=part.state.T_rig_station)
        part = replace(part, state=state, free=np.zeros_like(part.free))
        if np.count_nonzero(part.kept) >= LEAST_CORNERS:
            part = part.solved(None, 30)
            own[photo] = part.residuals[part.kept]
            other = across_views(part, shared, noise)
            if len(other.residuals):
                across[photo] = other
    return _HeldOut(own, across)


def _split_half(fit: Fit) -> tuple[float, dict[str, float]]:
    """Projection difference of two rigs, each solved from every other photo."""
    halves = [fit.of_photos(fit.photos[k::2]) for k in range(2)]
    views = [{h.views[v] for v in np.unique(h.looks.view)} for h in halves]
    common = [v for v in fit.views if all(v in seen for seen in views)]
    if len(fit.photos) < _LEAST_PHOTOS or len(common) < len(fit.views):
        return float("nan"), {}
    one, other = (h.solved(None, 30).rig for h in halves)
    difference = projection_difference(one, other, room_points(fit.rig, common, _POINTS))
    return difference.rms, dict(difference.by_view)


def deviations_of(calibration: Calibration) -> tuple[MirrorDeviation, ...]:
    """How far each mirror as built stands from the drawing."""
    p = calibration.parameters
    found = dict(zip(p.names, zip(p.value.tolist(), p.sigma.tolist())))
    out = []
    for mirror in calibration.nominal.mirrors:
        unknown = (0.0, float("nan"))
        u, v, shift = (found.get(f"{mirror}: {word}", unknown) for word in ("tilt u", "tilt v", "shift"))
        tilt = float(np.hypot(u[0], v[0]))
        sigma = float(np.hypot(u[0] * u[1], v[0] * v[1]) / tilt) if tilt > 0 else float(np.hypot(u[1], v[1]))
        out.append(MirrorDeviation(mirror, tilt, shift[0], sigma, shift[1]))
    return tuple(out)


def _usual_depth(fit: Fit) -> float:
    """Median distance of the boards, metres."""
    T = fit.state.T_rig_station[fit.looks.station] @ fit.state.T_station_board[fit.looks.board]
    return float(np.median(np.linalg.norm(T[:, :3, 3], axis=1)))


def _rms(residuals: object) -> float:
    joined = np.concatenate([np.empty((0, 2)), *residuals])  # type: ignore[misc]
    return float(np.sqrt(np.mean(np.sum(joined**2, axis=1)))) if len(joined) else float("nan")


def _tell(progress: Progress | None, done: int, total: int) -> None:
    if progress is not None:
        progress(done, total)
