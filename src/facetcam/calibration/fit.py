"""A calibration while it is being solved: the problem, where it stands, and which corners are believed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from facetcam.calibration import lens
from facetcam.calibration.assignment import Assignment
from facetcam.calibration.boards import BoardSet
from facetcam.calibration.least_squares import Prior, minimise
from facetcam.calibration.optics import MirrorOptics
from facetcam.calibration.problem import Looks, State, subset
from facetcam.calibration.sightings import Sighting
from facetcam.rig import NO_VIEW, Camera, Rig

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Tolerance:
    """How well the drawing is known, one standard deviation: what the photos leave open is held by it alone.

    Attributes
    ----------
    tilt : float
        Of each mirror, radians.
    shift : float
        Of each mirror along its normal, metres; at least 2 % of its distance from the camera.
    focal : float
        Of the focal length, as a share of it.
    """

    tilt: float = float(np.radians(3.0))
    shift: float = 0.005
    focal: float = 0.1


@dataclass(frozen=True, eq=False)
class Fit:
    """A problem and its state.

    Attributes
    ----------
    nominal : Rig
    views : tuple of str
        Views that have sightings, in the order of the indices.
    sightings : tuple of Sighting
        With their views, in the order of `looks`.
    looks : Looks
        All corners of the sightings.
    kept : (N,) bool array
        The corners that are believed.
    state : State
    free : (shared,) bool array
        Shared parameters that may move; held are those that are a matter of choice (gauge).
    prior : Prior
    stations : tuple of (photo, board or None)
    places : tuple of int
        Which board stands in each place of `state.T_station_board`; -1 where any does.
    part : (B,) int array
        For each place the first of the set of boards that were seen together.
    moved : mapping of (photo, board) to int
        Places of boards that were found to have moved in a set called fixed.
    """

    nominal: Rig
    views: tuple[str, ...]
    sightings: tuple[Sighting, ...]
    looks: Looks
    kept: Mask
    state: State
    free: Mask
    prior: Prior
    stations: tuple[tuple[int, int | None], ...]
    places: tuple[int, ...]
    part: Index
    moved: Mapping[tuple[int, int], int] = field(default_factory=dict)

    @property
    def camera(self) -> Camera:
        """The lens as it stands."""
        return lens.camera_of(self.state.intrinsics, self.nominal.camera)

    @property
    def rig(self) -> Rig:
        """The rig as it stands."""
        optics = self.state.optics
        assert isinstance(optics, MirrorOptics)
        return replace(optics.rig(self.nominal), camera=self.camera, covariance=None, solved_from=None)

    @property
    def residuals(self) -> Array:
        """Seen minus predicted (N, 2), of all corners."""
        return self.looks.pixels - self.state.predict(self.looks)

    def solved(self, loss: float | None, iterations: int = 50, free: Mask | None = None) -> Fit:
        """Minimise over the corners kept."""
        mask = self.free if free is None else self.free & free
        looks = self.looks.only(self.kept)
        return replace(self, state=minimise(self.state, looks, mask, self.prior, loss, iterations))

    @property
    def lens_held(self) -> Mask:
        """Mask of the shared parameters but the intrinsics."""
        return np.arange(self.state.shared) >= len(self.state.intrinsics)

    def place_of(self, sighting: Sighting) -> tuple[int, int] | None:
        """Indices of the board's place and of the station of a sighting; None where the pose is not known."""
        if self.places == (-1,):
            key: tuple[int, int | None] = (sighting.photo, sighting.board)
            return (0, self.stations.index(key)) if key in self.stations else None
        if (sighting.photo, None) not in self.stations:
            return None
        station = self.stations.index((sighting.photo, None))
        here = self.looks.board[self.looks.station == station]
        place = self.moved.get((sighting.photo, sighting.board), sighting.board)
        return (place, station) if self.part[place] in self.part[here] else None

    def of_photos(self, photos: Sequence[int]) -> Fit:
        """The part of some photos, with the boards and the rig as they stand."""
        chosen = [i for i, s in enumerate(self.sightings) if s.photo in set(photos)]
        looks, state, stations = subset(self.looks, self.state, chosen)
        parts = [self.kept[a:b] for a, b in (self.looks.bounds[i] for i in chosen)]
        return replace(
            self,
            sightings=tuple(self.sightings[i] for i in chosen),
            looks=looks,
            state=state,
            kept=np.concatenate([np.empty(0, dtype=bool), *parts]),
            stations=tuple(self.stations[p] for p in stations),
        )

    @property
    def photos(self) -> list[int]:
        """Photos with sightings, ascending."""
        return sorted({s.photo for s in self.sightings})


def begin(
    nominal: Rig,
    camera: Camera,
    boards: BoardSet,
    views: Sequence[str],
    assignment: Assignment,
    tolerance: Tolerance,
) -> Fit:
    """The joint problem of all sightings that have a view, at the rough poses."""
    used = np.flatnonzero(assignment.view != NO_VIEW).tolist()
    seen = tuple(v for i, v in enumerate(views) if i in set(assignment.view[used].tolist()))
    named = [replace(assignment.sightings[i], view=views[assignment.view[i]]) for i in used]
    station = np.unique(assignment.station[used])
    optics = MirrorOptics.of(nominal, seen, tolerance.tilt, tolerance.shift)
    state = State(
        camera.model,
        lens.values_of(camera),
        optics,
        assignment.T_station_board,
        assignment.T_rig_station[station],
    )
    looks = looks_of(
        named, boards, seen, assignment.board[used], np.searchsorted(station, assignment.station[used])
    )
    return Fit(
        nominal,
        seen,
        tuple(named),
        looks,
        np.ones(len(looks.pixels), dtype=bool),
        state,
        _free(state, optics, np.unique(looks.board), assignment.part),
        Prior(lens.values_of(nominal.camera), lens.tolerances(nominal.camera, tolerance.focal)),
        tuple(assignment.stations[p] for p in station),
        tuple(range(len(boards.boards))) if boards.fixed else (-1,),
        assignment.part,
    )


def looks_of(
    sightings: Sequence[Sighting],
    boards: BoardSet,
    views: Sequence[str],
    board: Sequence[int] | NDArray[np.int64],
    station: Sequence[int] | NDArray[np.int64],
) -> Looks:
    """Join sightings that have views."""
    return Looks.of(
        [s.pixels for s in sightings],
        [boards.boards[s.board].points[s.corners] for s in sightings],
        [list(views).index(s.view or "") for s in sightings],
        board,
        station,
    )


def gauge_mirror(optics: MirrorOptics) -> int | None:
    """The mirror through which everything is seen, if there is one: where it stands is a matter of choice."""
    firsts = {chain[0] if chain else None for chain in optics.chains}
    later = {m for chain in optics.chains for m in chain[1:]}
    only = firsts.pop() if len(firsts) == 1 else None
    return only if only not in later else None


def _free(state: State, optics: MirrorOptics, boards: Index, part: Index) -> Mask:
    free = np.ones(state.shared, dtype=bool)
    gauge = gauge_mirror(optics)
    lenses = len(state.intrinsics)
    free[lenses : state.first_board] = np.isfinite(optics.tolerance)
    if gauge is not None:
        free[lenses + 3 * gauge : lenses + 3 * gauge + 3] = False
    held = set(range(len(state.T_station_board))) - set(boards.tolist()) | set(part.tolist())
    for b in held:
        free[state.first_board + 6 * b : state.first_board + 6 * b + 6] = False
    return free
