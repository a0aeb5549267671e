"""Boards of a set called fixed that moved between photos: an explanation, and what it is worth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from facetcam.calibration.boards import BoardSet
from facetcam.calibration.evidence import (
    CLEAR,
    LEAST,
    TIGHT,
    Explanation,
    is_mended,
    is_wrong,
    misfit,
    sighting_errors,
    snap,
    stations_only,
)
from facetcam.calibration.fit import Fit
from facetcam.calibration.least_squares import minimise
from facetcam.calibration.problem import Looks, State, subset
from facetcam.calibration.result import Finding
from facetcam.geometry import se3

Array = NDArray[np.float64]

_CORNERS = 8  # that a board must show
_LOSSES = (30.0, 3.0)  # pixels
_TRIALS = 3  # boards that are solved for in full
_ROUNDS = 3  # of sorting photos by where a board stands in them


def moved_board(fit: Fit, boards: BoardSet, noise: float, least: float = LEAST) -> Explanation | None:
    """Give one board of a fixed set a second place, in the photos that ask for it.

    Of two boards seen together either may have moved: every board is tried, and the one is named with which
    all photos together fit best, or all that the photos cannot tell apart.

    Parameters
    ----------
    noise : float
        Pixels that a corner coordinate is good to.
    least : float
        Pixels that a board must be off at least.
    """
    places, loss = _new_places(fit, noise, least), snap(noise)
    quick = []
    for board in sorted({b for _, b in places}):
        photos, pose = _together(fit, board, places)
        trial = _placed_anew(fit, board, photos, pose)
        only = np.arange(trial.state.shared) >= trial.state.shared - 6
        roughly = replace(trial, free=only).solved(loss, 10)
        quick.append((total(roughly, noise), board, replace(roughly, free=trial.free)))
    quick.sort(key=lambda item: item[:2])
    solved = [_sorted_out(fit, trial, board, noise, loss) for _, board, trial in quick[:_TRIALS]]
    trials = sorted((t for t in solved if t is not None), key=lambda t: t.misfit)
    if not trials:
        return None
    best = trials[0]
    as_likely = [t.board for t in trials if t.misfit < best.misfit + CLEAR]
    as_likely += sorted(_only_companions(best) - set(as_likely))
    return Explanation(best.fit, _finding(best, boards, as_likely), best.misfit, 6)


@dataclass(frozen=True, eq=False)
class _Trial:
    """A board with a new place, the newest of the fit, in some photos."""

    fit: Fit
    board: int
    photos: list[int]
    misfit: float


def _sorted_out(before: Fit, fit: Fit, board: int, noise: float, loss: float) -> _Trial | None:
    """Solve with a board's newest place, and sort the photos by where it stands in them, in turns."""
    place = len(fit.places) - 1
    photos = [p for p in fit.photos if fit.moved.get((p, board)) == place]
    usual = {s.photo: before.moved.get((s.photo, board), board) for s in fit.sightings if s.board == board}
    for _ in range(_ROUNDS):
        fit = fit.solved(10.0, 20).solved(TIGHT, 20).solved(loss, 20)
        old, new = (
            misfit(stations_only(standing(fit, board, where)), noise)
            for where in (usual, dict.fromkeys(usual, place))
        )
        again = [p for p in usual if new[p] < old[p] - 1.0]
        if again == photos:
            break
        if not again:
            return None
        photos = again
        fit = standing(fit, board, usual | dict.fromkeys(photos, place))
    return _Trial(fit, board, photos, total(fit, noise))


def _only_companions(trial: _Trial) -> set[int]:
    """The one board, if so, beside which a board is seen at its new place: it may as well have moved."""
    sets = [
        {s.board for s in trial.fit.sightings if s.photo == photo} - {trial.board} for photo in trial.photos
    ]
    beside = set().union(*sets)
    return beside if len(beside) == 1 else set()


def total(fit: Fit, noise: float) -> float:
    return sum(misfit(fit, noise).values())


def _new_places(fit: Fit, noise: float, least: float) -> dict[tuple[int, int], Array]:
    """Boards that stand elsewhere in a photo, the rig pose taken from the photo's other boards."""
    found = {}
    errors = sighting_errors(stations_only(fit))
    for photo in fit.photos:
        here = [i for i, s in enumerate(fit.sightings) if s.photo == photo]
        seen = sorted({fit.sightings[i].board for i in here})
        # Of boards that stand apart the pose of all shows at least half on one of them.
        if len(seen) < 2 or not is_wrong(2.0 * float(errors[here].max()), noise, least):
            continue
        for board in seen:
            own = [i for i in here if fit.sightings[i].board == board]
            others = [i for i in here if i not in own]
            if min(_corners(fit, own), _corners(fit, others)) >= _CORNERS:
                pose = _pose_apart(fit, own, others, noise, least)
                if pose is not None:
                    found[photo, board] = pose
    return found


def _corners(fit: Fit, sightings: Sequence[int]) -> int:
    return sum(len(fit.sightings[i]) for i in sightings)


def _pose_apart(
    fit: Fit, own: Sequence[int], others: Sequence[int], noise: float, least: float
) -> Array | None:
    """Where a board stands in the frame of its set, if not where it should."""
    nothing = np.zeros(fit.state.shared, dtype=bool)
    looks, state, _ = subset(fit.looks, fit.state, others)
    rig = minimise(state, looks, nothing, fit.prior, _LOSSES[1], 20).T_rig_station[0]
    looks, state, _ = subset(fit.looks, fit.state, own)
    state = replace(state, T_rig_station=rig[None])
    before = _median_error(state, looks)
    if not is_wrong(before, noise, least):
        return None
    freed = state
    for loss in _LOSSES:
        freed = minimise(freed, looks, nothing, fit.prior, loss, 20)
    if not is_mended(before, _median_error(freed, looks), noise):
        return None
    place = int(looks.board[0])
    return np.asarray(se3.inverse(rig) @ freed.T_rig_station[0] @ state.T_station_board[place])


def _median_error(state: State, looks: Looks) -> float:
    return float(np.median(np.linalg.norm(looks.pixels - state.predict(looks), axis=1)))


def _together(fit: Fit, board: int, moved: Mapping[tuple[int, int], Array]) -> tuple[list[int], Array]:
    """The photos in which a board stands at one new place, and that place; of several the commonest."""
    poses = {photo: T for (photo, b), T in moved.items() if b == board}
    middle = np.zeros((1, 3))

    def gap(a: Array, b: Array) -> float:
        return float(np.linalg.norm(se3.transform(a, middle) - se3.transform(b, middle)))

    sets = []
    for photo, T in poses.items():
        away = gap(T, fit.state.T_station_board[fit.moved.get((photo, board), board)])
        sets.append(([p for p, other in poses.items() if gap(T, other) < 0.3 * away + 1e-4], T))
    photos, pose = max(sets, key=lambda found: len(found[0]))
    return photos, pose


def _placed_anew(fit: Fit, board: int, photos: Sequence[int], pose: Array) -> Fit:
    state = replace(fit.state, T_station_board=np.concatenate([fit.state.T_station_board, pose[None]]))
    wider = replace(
        fit,
        places=(*fit.places, board),
        part=np.append(fit.part, fit.part[board]),
        state=state,
        free=np.concatenate([fit.free, np.ones(6, dtype=bool)]),
    )
    return standing(wider, board, dict.fromkeys(photos, len(fit.places)))


def standing(fit: Fit, board: int, where: Mapping[int, int]) -> Fit:
    """The fit with a board at these places in these photos."""
    place = fit.looks.board.copy()
    for i, s in enumerate(fit.sightings):
        if s.board == board and s.photo in where:
            place[i] = where[s.photo]
    moved = {**fit.moved, **{(photo, board): at for photo, at in where.items()}}
    kept = {key: at for key, at in moved.items() if at != key[1]}
    return replace(fit, looks=replace(fit.looks, board=place), moved=kept)


def _finding(trial: _Trial, boards: BoardSet, as_likely: Sequence[int]) -> Finding:
    fit, board = trial.fit, trial.board
    before, pose = fit.state.T_station_board[board], fit.state.T_station_board[-1]
    middle = boards.boards[board].points.mean(axis=0)[None]
    away = 1e3 * np.linalg.norm(se3.transform(pose, middle) - se3.transform(before, middle))
    turn = np.degrees(np.linalg.norm(se3.log(se3.inverse(before) @ pose)[:3]))
    # A board alone in a photo tells nothing of where it stands among the others.
    beside = {s.photo for s in fit.sightings if s.board != board}
    elsewhere = sorted({s.photo for s in fit.sightings if s.board == board} & beside - set(trial.photos))
    photos = min((elsewhere, trial.photos), key=len) if elsewhere else trial.photos
    names = " or ".join(f"'{boards.boards[b].name}'" for b in as_likely)
    untold = "; which of them it was, these photos cannot tell" if len(as_likely) > 1 else ""
    text = (
        f"board {names} of the fixed set moved: in photos {{photos}}"
        f" '{boards.boards[board].name}' stands {away:.1f} mm and {turn:.2f} degrees from where it stands in"
        f" the others{untold}; it counts as another board there"
    )
    return Finding("moved board", text, tuple(photos))
