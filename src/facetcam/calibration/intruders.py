"""Photos of another camera, and boards of a fixed set that moved: found, named and worked round."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from facetcam.calibration.boards import BoardSet
from facetcam.calibration.fit import Fit
from facetcam.calibration.least_squares import minimise
from facetcam.calibration.problem import subset
from facetcam.calibration.rejection import noise_of
from facetcam.calibration.result import Finding
from facetcam.geometry import se3

Array = NDArray[np.float64]

_WRONG = 5.0  # noises that a photo or board must be off to be looked into
_LEAST = 0.5  # and pixels
_MENDED = 0.4  # of its error must remain at most when it is set free
_OTHER_FOCAL = 0.004  # share by which another camera's focal length differs
_CORNERS = 8  # that a board must show
_LOSS = 3.0  # pixels
_TIGHT = 1.0  # pixels: more than a wrong board lets the majority give way
_TRIALS = 3  # boards that may be the one that moved
_WORTH = 0.95  # of the misfit that may remain when a board is placed anew


def without_other_cameras(fit: Fit) -> tuple[Fit, tuple[Finding, ...]]:
    """Leave out photos that fit only with another focal length."""
    # A tight loss lets the majority snap into place, and so shows who stands apart.
    tight = fit.solved(_TIGHT)
    sigma = noise_of(tight)
    found = {}
    for photo in tight.photos:
        part = tight.of_photos([photo])
        before = _error(part)
        if before < max(_WRONG * sigma, _LEAST) or len(part.sightings) < 2:
            continue
        free = np.zeros(part.state.shared, dtype=bool)
        free[:2] = True
        freed = replace(part, free=free).solved(100.0, 20).solved(10.0, 20).solved(_LOSS, 20)
        focal = freed.state.intrinsics[0]
        # Every sighting must fit then: one in the wrong view may well suit a wrong focal length.
        if (
            _worst(freed) < max(_MENDED * before, 2.0 * sigma)
            and abs(focal / tight.state.intrinsics[0] - 1.0) > _OTHER_FOCAL
        ):
            found[photo] = focal
    rest = [p for p in fit.photos if p not in found]
    if not found or not rest:
        return tight, ()
    others = ", ".join(str(p) for p in found)
    text = (
        f"photos {others} fit only a focal length of {np.median(list(found.values())):.0f} px, the others"
        f" {tight.state.intrinsics[0]:.0f} px: another camera or zoom; they are left out"
    )
    left = tight.of_photos(rest).solved(10.0)
    return left, (Finding("other camera", text, tuple(found)),)


def with_moved_boards(fit: Fit, boards: BoardSet) -> tuple[Fit, tuple[Finding, ...]]:
    """Give boards of a fixed set that moved a second place for the photos in which they stand there."""
    findings: list[Finding] = []
    for _ in range(len(boards.boards) if boards.fixed else 0):
        moved = _moved(fit)
        if not moved:
            break
        # Two boards moved against each other: which of them it was, the other photos tell.
        counts = Counter(b for _, b in moved)
        likely = [b for b, n in counts.most_common(_TRIALS) if n > 0.6 * max(counts.values())]
        trials = [_placed_anew(fit, b, *_together(fit, b, moved)) for b in likely]
        trials = [trial.solved(10.0, 20).solved(_TIGHT, 20) for trial in trials]
        best = int(np.argmin([_misfit(trial) for trial in trials]))
        if _misfit(trials[best]) > _WORTH * _misfit(fit):
            break
        photos, pose = _together(fit, likely[best], moved)
        findings.append(_finding(fit, boards, likely[best], photos, pose))
        fit = trials[best]
    return fit, tuple(findings)


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


def _misfit(fit: Fit) -> float:
    squares = np.sum(fit.residuals**2, axis=1)
    return float(np.log1p(squares / _TIGHT**2).sum())


def _moved(fit: Fit) -> dict[tuple[int, int], Array]:
    """Boards that stand elsewhere in a photo, the rig pose taken from the photo's other boards."""
    sigma = noise_of(fit)
    found = {}
    for photo in fit.photos:
        here = [i for i, s in enumerate(fit.sightings) if s.photo == photo]
        seen = {fit.sightings[i].board for i in here}
        for board in seen if len(seen) > 1 else ():
            own = [i for i in here if fit.sightings[i].board == board]
            others = [i for i in here if i not in own]
            if min(_corners(fit, own), _corners(fit, others)) < _CORNERS:
                continue
            pose = _pose_apart(fit, own, others, sigma)
            if pose is not None:
                found[photo, board] = pose
    return found


def _pose_apart(fit: Fit, own: Sequence[int], others: Sequence[int], sigma: float) -> Array | None:
    """Where a board stands in the frame of its set, if not where it should."""
    nothing = np.zeros(fit.state.shared, dtype=bool)
    looks, state, _ = subset(fit.looks, fit.state, others)
    rig = minimise(state, looks, nothing, fit.prior, _LOSS, 20).T_rig_station[0]
    looks, state, _ = subset(fit.looks, fit.state, own)
    state = replace(state, T_rig_station=rig[None])
    before = float(np.median(np.linalg.norm(looks.pixels - state.predict(looks), axis=1)))
    if before < max(_WRONG * sigma, _LEAST):
        return None
    freed = minimise(state, looks, nothing, fit.prior, 10 * _LOSS, 20)
    freed = minimise(freed, looks, nothing, fit.prior, _LOSS, 20)
    after = float(np.median(np.linalg.norm(looks.pixels - freed.predict(looks), axis=1)))
    if after > _MENDED * before:
        return None
    place = int(looks.board[0])
    return np.asarray(se3.inverse(rig) @ freed.T_rig_station[0] @ state.T_station_board[place])


def _placed_anew(fit: Fit, board: int, photos: Sequence[int], pose: Array) -> Fit:
    place, state = len(fit.places), fit.state
    moved = {**fit.moved, **{(photo, board): place for photo in photos}}
    chosen = [s.board == board and s.photo in photos for s in fit.sightings]
    return replace(
        fit,
        places=(*fit.places, board),
        part=np.append(fit.part, fit.part[board]),
        moved=moved,
        looks=replace(fit.looks, board=np.where(chosen, place, fit.looks.board)),
        state=replace(state, T_station_board=np.concatenate([state.T_station_board, pose[None]])),
        free=np.concatenate([fit.free, np.ones(6, dtype=bool)]),
    )


def _finding(fit: Fit, boards: BoardSet, board: int, photos: Sequence[int], pose: Array) -> Finding:
    middle = boards.boards[board].points.mean(axis=0)[None]
    before = fit.state.T_station_board[board]
    away = 1e3 * np.linalg.norm(se3.transform(pose, middle) - se3.transform(before, middle))
    turn = np.degrees(np.linalg.norm(se3.log(se3.inverse(before) @ pose)[:3]))
    text = (
        f"board '{boards.boards[board].name}' of the fixed set moved: in photos {', '.join(map(str, photos))}"
        f" it stands {away:.1f} mm and {turn:.2f} degrees from where it stands in the others;"
        " it counts as another board there"
    )
    return Finding("moved board", text, tuple(photos))


def _corners(fit: Fit, sightings: Sequence[int]) -> int:
    return sum(len(fit.sightings[i]) for i in sightings)


def _worst(fit: Fit) -> float:
    """Error of the sighting that fits worst."""
    lengths = np.linalg.norm(fit.residuals, axis=1)
    return max(float(np.median(lengths[a:b])) for a, b in fit.looks.bounds if b > a)


def _error(fit: Fit) -> float:
    return float(np.median(np.linalg.norm(fit.residuals, axis=1)))
