"""Levenberg-Marquardt over shared parameters and station poses, the poses eliminated (Schur complement)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from facetcam.calibration.problem import Looks, State, linearise

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_LEAST_DAMPING = 1e-12
_MOST_DAMPING = 1e10
_RIDGE = 1e-13  # keeps a number that nothing touches where it is
_FLAT = 1e-10  # relative drop of the cost at which a solve has converged
_COARSE = (1e-6, 1e-4)  # the same under a loss up to, and beyond, so many pixels:
_COARSE_LOSS = 5.0


@dataclass(frozen=True, eq=False)
class Prior:
    """What the drawing says of the shared parameters: values in units of their tolerance.

    Attributes
    ----------
    nominal : (I,) array
        Intrinsics of the drawing.
    tolerance : (I,) array
    noise : float
        Pixels a corner is seen with; weighs the photos against the drawing.
    """

    nominal: Array
    tolerance: Array
    noise: float = 0.1

    def rows(self, state: State) -> tuple[Array, Array]:
        """Offset from the drawing in units of `noise` pixels, and its slope, both (shared,)."""
        offset, slope = np.zeros(state.shared), np.zeros(state.shared)
        lenses = len(state.intrinsics)
        offset[:lenses] = (state.intrinsics - self.nominal) / self.tolerance
        offset[lenses : state.first_board] = state.optics.offsets
        slope[: state.first_board] = 1.0 / np.concatenate([self.tolerance, state.optics.tolerance])
        return self.noise * offset, self.noise * slope


@dataclass(frozen=True, eq=False)
class Normal:
    """Normal equations: shared block, station blocks, and what couples them."""

    A: Array  # (G, G)
    B: Array  # (P, G, 6)
    C: Array  # (P, 6, 6)
    a: Array  # (G,)
    c: Array  # (P, 6)

    def reduced(self, damping: float = 0.0) -> tuple[Array, Array, Array, Array]:
        """Shared block and right side after the stations are eliminated, with what gives their steps."""
        size = np.trace(self.C, axis1=1, axis2=2)[:, None, None]
        C = self.C + damping * _diagonal(self.C) + (_RIDGE * size + 1e-9) * np.eye(6)
        solved = np.linalg.solve(C, np.concatenate([np.swapaxes(self.B, 1, 2), self.c[:, :, None]], axis=2))
        into, right = solved[:, :, :-1], solved[:, :, -1]
        flat = np.swapaxes(self.B, 0, 1).reshape(len(self.a), 6 * len(C))
        A = self.A + damping * np.diag(np.diag(self.A)) - flat @ into.reshape(6 * len(C), len(self.a))
        return A, self.a - flat @ right.reshape(-1), into, right


def normal_equations(state: State, looks: Looks, weights: Array) -> Normal:
    """Sum the normal equations of the sightings: each touches few columns and one station."""
    linear = linearise(state, looks)
    G, P = state.shared, len(state.T_rig_station)
    A, B, C = np.zeros((G, G)), np.zeros((P, G, 6)), np.zeros((P, 6, 6))
    a, c = np.zeros(G), np.zeros((P, 6))
    root = (np.sqrt(weights) / looks.noise)[:, None]
    rows = np.concatenate(
        [linear.shared, linear.station, (looks.pixels - linear.predicted)[:, :, None]], axis=2
    )
    rows *= root[:, :, None]
    width = linear.shared.shape[2]
    blocks = (rows[first:last].reshape(-1, rows.shape[2]) for first, last in looks.bounds)
    products = np.array([block.T @ block for block in blocks]).reshape(-1, rows.shape[2], rows.shape[2])
    np.add.at(C, looks.station, products[:, width:-1, width:-1])
    np.add.at(c, looks.station, products[:, width:-1, -1])
    for view, board in sorted(set(zip(looks.view.tolist(), looks.board.tolist()))):
        alike = (looks.view == view) & (looks.board == board)
        own = state.first_board + 6 * board + np.arange(6)
        columns, summed = np.concatenate([linear.columns[view], own]), products[alike].sum(axis=0)
        # A chain may meet one mirror twice: its columns then repeat and must be summed.
        np.add.at(A, (columns[:, None], columns), summed[:width, :width])
        np.add.at(a, columns, summed[:width, -1])
        np.add.at(B, (looks.station[alike, None], columns), products[alike, :width, width:-1])
    return Normal(A, B, C, a, c)


def restricted(normal: Normal, free: Mask) -> Normal:
    """The equations of the free shared parameters only."""
    return Normal(normal.A[np.ix_(free, free)], normal.B[:, free], normal.C, normal.a[free], normal.c)


def minimise(
    state: State,
    looks: Looks,
    free: Mask,
    prior: Prior,
    loss: float | None = None,
    iterations: int = 50,
) -> State:
    """Fit the state to what was seen.

    Parameters
    ----------
    free : (shared,) bool array
        Shared parameters that may move; station poses always do.
    prior : Prior
        Weak pull to the drawing, which alone moves what the photos leave open.
    loss : float, optional
        Residual in pixels beyond which a corner counts less and less (Cauchy); None for plain least squares.
    """
    cost, weights = _cost(state, looks, prior, loss)
    damping = 1e-4
    for _ in range(iterations):
        normal = restricted(_with_prior(normal_equations(state, looks, weights), state, prior), free)
        dropped = 0.0
        while damping < _MOST_DAMPING:
            trial = _stepped(state, normal, free, damping)
            trial_cost, trial_weights = _cost(trial, looks, prior, loss)
            if trial_cost <= cost:
                dropped = (cost - trial_cost) / max(cost, 1e-300)
                state, cost, weights = trial, trial_cost, trial_weights
                damping = max(damping / 10.0, _LEAST_DAMPING)
                break
            damping *= 10.0
        if dropped < (_FLAT if loss is None else _COARSE[loss > _COARSE_LOSS]):
            break
    return state


def _with_prior(normal: Normal, state: State, prior: Prior) -> Normal:
    offset, slope = prior.rows(state)
    A = normal.A + np.diag(slope**2)
    return Normal(A, normal.B, normal.C, normal.a - slope * offset, normal.c)


def _stepped(state: State, normal: Normal, free: Mask, damping: float) -> State:
    A, a, into, right = normal.reduced(damping)
    step = np.zeros(state.shared)
    if len(a):
        scale = 1.0 / np.sqrt(np.maximum(np.diag(normal.A), 1e-12))
        scaled = scale[:, None] * A * scale + _RIDGE * np.eye(len(a))
        step[free] = scale * np.linalg.solve(scaled, scale * a)
    return state.moved(step, right - into @ step[free])


def _cost(state: State, looks: Looks, prior: Prior, loss: float | None) -> tuple[float, Array]:
    """Cost, and the weight of every corner."""
    squares = np.sum((looks.pixels - state.predict(looks)) ** 2, axis=1) / looks.noise**2
    offset = prior.rows(state)[0]
    drawn = float(offset @ offset)
    if loss is None:
        return drawn + float(squares.sum()), np.ones(len(squares))
    relative = squares / loss**2
    return drawn + loss**2 * float(np.log1p(relative).sum()), 1.0 / (1.0 + relative)


def _diagonal(C: Array) -> Array:
    """The diagonals of a stack of matrices, as matrices."""
    return C * np.eye(C.shape[-1])
