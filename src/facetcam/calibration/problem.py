"""What was seen, what may move, and how far the two are apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from facetcam.calibration import lens
from facetcam.calibration.optics import Optics
from facetcam.geometry import se3

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Looks:
    """Corners seen, joined for all sightings; the corners of one sighting stand together.

    Attributes
    ----------
    pixels : (N, 2) array
    points : (N, 3) array
        On the board.
    sighting : (N,) int array
        Which sighting each corner belongs to, ascending.
    view, board, station : (S,) int arrays
        Of each sighting: index of the view, of the board's place, and of the rig pose it was seen from.
        Boards that move against each other have one station a photo and board.
    spread : (S,) array
        Noise of each sighting's corners against that of the others: small or blurred squares are seen worse.
    """

    pixels: Array
    points: Array
    sighting: Index
    view: Index
    board: Index
    station: Index
    spread: Array

    @classmethod
    def of(
        cls,
        pixels: Sequence[Array],
        points: Sequence[Array],
        view: Sequence[int] | Index,
        board: Sequence[int] | Index,
        station: Sequence[int] | Index,
    ) -> Looks:
        """Join sightings given one by one."""
        sighting = np.repeat(np.arange(len(pixels)), [len(p) for p in pixels])
        return cls(
            np.concatenate([np.empty((0, 2)), *pixels]),
            np.concatenate([np.empty((0, 3)), *points]),
            sighting,
            np.array(view, dtype=np.int64),
            np.array(board, dtype=np.int64),
            np.array(station, dtype=np.int64),
            np.ones(len(pixels)),
        )

    @cached_property
    def bounds(self) -> list[tuple[int, int]]:
        """First corner of each sighting, and the one after its last."""
        ends = np.searchsorted(self.sighting, np.arange(len(self.view) + 1))
        return list(zip(ends[:-1].tolist(), ends[1:].tolist()))

    @cached_property
    def by_view(self) -> list[tuple[int, Index]]:
        """Views seen, with the indices of their corners."""
        view = self.view[self.sighting]
        return [(int(v), np.flatnonzero(view == v)) for v in np.unique(view)]

    @property
    def noise(self) -> Array:
        """Of each corner (N,), against the others."""
        return self.spread[self.sighting]

    def only(self, kept: NDArray[np.bool_]) -> Looks:
        """The corners of a mask (N,); sightings keep their indices, even with no corner left."""
        return replace(self, pixels=self.pixels[kept], points=self.points[kept], sighting=self.sighting[kept])


@dataclass(frozen=True, eq=False)
class State:
    """Everything that the solver may move.

    Attributes
    ----------
    model : str
        Of the lens.
    intrinsics : (I,) array
    optics : Optics
    T_station_board : (B, 4, 4) array
    T_rig_station : (P, 4, 4) array
    """

    model: str
    intrinsics: Array
    optics: Optics
    T_station_board: Array
    T_rig_station: Array

    @property
    def shared(self) -> int:
        """Number of parameters that photos share: intrinsics, optics, boards."""
        return len(self.intrinsics) + self.optics.count + 6 * len(self.T_station_board)

    @property
    def first_board(self) -> int:
        """Where the boards begin among the shared parameters."""
        return len(self.intrinsics) + self.optics.count

    def moved(self, shared: Array, stations: Array) -> State:
        """The state after a step of the shared parameters and of the station poses (P, 6)."""
        stations_moved = se3.exp(stations) @ self.T_rig_station
        if not shared.any():  # the optics keep what they have worked out
            return replace(self, T_rig_station=stations_moved)
        lenses, optics, boards = np.split(shared, [len(self.intrinsics), self.first_board])
        return replace(
            self,
            intrinsics=self.intrinsics + lenses,
            optics=self.optics.moved(optics),
            T_station_board=se3.exp(boards.reshape(-1, 6)) @ self.T_station_board,
            T_rig_station=stations_moved,
        )

    def predict(self, looks: Looks) -> Array:
        """Pixels (N, 2) at which the corners should be seen."""
        points = self.in_rig(looks)[1]
        out = np.empty((len(points), 2))
        for view, rows in looks.by_view:
            seen = self.optics.into_camera(view, points[rows])
            out[rows] = lens.project(self.model, self.intrinsics, seen)
        return out

    def in_rig(self, looks: Looks) -> tuple[Array, Array]:
        """Corners in the frames of their stations and of the rig."""
        board, station = looks.board[looks.sighting], looks.station[looks.sighting]
        standing = _each(self.T_station_board[board], looks.points)
        return standing, _each(self.T_rig_station[station], standing)


def subset(looks: Looks, state: State, chosen: Sequence[int]) -> tuple[Looks, State, Index]:
    """The part of a problem that concerns some of its sightings.

    Returns
    -------
    looks, state
        With those stations only.
    stations : (P,) int array
        Which stations of the whole these are.
    """
    chosen = list(chosen)
    stations, station = np.unique(looks.station[chosen], return_inverse=True)
    parts = [slice(*looks.bounds[s]) for s in chosen]
    pixels, points = [looks.pixels[p] for p in parts], [looks.points[p] for p in parts]
    part = Looks.of(pixels, points, looks.view[chosen], looks.board[chosen], station)
    part = replace(part, spread=looks.spread[chosen])
    return part, replace(state, T_rig_station=state.T_rig_station[stations]), stations


@dataclass(frozen=True, eq=False)
class Linear:
    """The prediction of every corner, and its derivatives.

    Attributes
    ----------
    predicted : (N, 2) array
    shared : (N, 2, C) array
        By the shared parameters that the corner's sighting depends on.
    station : (N, 2, 6) array
    columns : (V, C) int array
        Per view, the parameters of `shared`; the board's six come last and count from the board's own first.
    """

    predicted: Array
    shared: Array
    station: Array
    columns: Index


def linearise(state: State, looks: Looks) -> Linear:
    """Predict all corners with derivatives."""
    standing, points = state.in_rig(looks)
    lenses = len(state.intrinsics)
    widths = {view: len(state.optics.columns(view)) for view, _ in looks.by_view}
    width = max(widths.values(), default=0)
    predicted = np.empty((len(points), 2))
    shared = np.zeros((len(points), 2, lenses + width + 6))
    by_rig = np.empty((len(points), 2, 3))
    columns = np.zeros((int(looks.view.max(initial=-1)) + 1, lenses + width), dtype=np.int64)
    for view, rows in looks.by_view:
        by_points, by_optics = state.optics.derivatives(view, points[rows])
        seen = state.optics.into_camera(view, points[rows])
        predicted[rows], by_seen, by_lens = lens.project_with_derivatives(state.model, state.intrinsics, seen)
        used = slice(lenses, lenses + widths[view])
        shared[rows, :, :lenses] = by_lens
        shared[rows, :, used] = by_seen @ by_optics
        by_rig[rows] = by_seen @ by_points
        columns[view, :lenses] = np.arange(lenses)
        columns[view, used] = lenses + state.optics.columns(view)
    R = state.T_rig_station[looks.station[looks.sighting], :3, :3]
    by_standing = by_rig @ R
    shared[:, :, -6:-3], shared[:, :, -3:] = by_standing @ -se3.skew(standing), by_standing
    station = np.concatenate([by_rig @ -se3.skew(points), by_rig], axis=2)
    return Linear(predicted, shared, station, columns)


def _each(T: Array, points: Array) -> Array:
    """Move every point (N, 3) by a motion of its own (N, 4, 4)."""
    moved: Array = np.einsum("nij,nj->ni", T[:, :3, :3], points) + T[:, :3, 3]
    return moved
