"""The best rig of a family inside an envelope: differential evolution over exact areas."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import Bounds, differential_evolution

from facetcam.design.areas import Area, view_areas
from facetcam.design.family import build, check_built
from facetcam.design.spec import GOALS, Body, CameraSpec, DesignSpec, Family, Goal
from facetcam.errors import ConfigError, RigError
from facetcam.rig import Rig

Array = NDArray[np.float64]

RESOLUTION_UNIT = 20.0  # pixels a degree that count as much as full coverage
BASELINE_UNIT = 0.1  # metres that do

_AZIMUTHS = 720
_ROWS = 5  # elevations in the band
_SMALLEST_VIEW = 1e-3  # steradians, below which a view is no view
_IMPOSSIBLE = -10.0
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class Qualities:
    """What a search weighs: coverage and overlap are shares of the band about the horizon.

    `resolution` is in pixels a degree on the axis of the lens, `baseline` the mean distance (m) from a view
    centre to the nearest other one, `overlap` the share that two or more views see.
    """

    coverage: float
    resolution: float
    baseline: float
    overlap: float

    def score(self, goal: Goal) -> float:
        """Weighted sum, each in its unit (`RESOLUTION_UNIT`, `BASELINE_UNIT`, or a share)."""
        return (
            goal.coverage * self.coverage
            + goal.resolution * self.resolution / RESOLUTION_UNIT
            + goal.baseline * self.baseline / BASELINE_UNIT
            + goal.overlap * self.overlap
        )


@dataclass(frozen=True, slots=True)
class Found:
    """The best design of a search, against the one it began with, and all candidates that could be built."""

    spec: DesignSpec
    best: Qualities
    start: Qualities | None  # None: the start itself does not fit the envelope or cannot be built
    candidates: Array  # (N, 4) coverage, resolution, baseline, overlap
    history: Array  # (G,) best score after each generation
    evaluations: int


def search(
    spec: DesignSpec, seed: int = 0, progress: Callable[[int, int | None], None] = lambda done, total: None
) -> Found:
    """Maximise the goal of a design over the parameters that its bounds leave free.

    Raises
    ------
    ConfigError
        If the design is no family, nothing is free, no candidate could be built, or none gains anything.
    """
    if spec.family is None:
        raise ConfigError("search: a rig of its own has no parameters to change; give a family")
    wish, space = spec.search, _Space(spec)
    if space.keeps_lens and not (wish.goal.coverage or wish.goal.baseline or wish.goal.overlap):
        raise ConfigError(
            "search: the lens alone decides pixels per degree; free it, as in bounds: {focal: [800, 2500]}"
        )
    band = _band(math.radians(wish.band_degrees))
    seen: list[Qualities] = []
    scores: dict[bytes, float] = {}

    def cost(x: Array) -> float:
        if x.tobytes() not in scores:
            found, penalty = evaluate(*space.design(x), spec.body, wish.envelope, band)
            if found is not None:
                seen.append(found)
            scores[x.tobytes()] = penalty if found is None else found.score(wish.goal)
        return -scores[x.tobytes()]

    history: list[float] = []

    def tell(intermediate_result: Any) -> None:
        history.append(-float(intermediate_result.fun))
        progress(len(history), wish.generations)

    low, high = np.transpose(space.bounds)
    result = differential_evolution(
        cost, Bounds(low, high), x0=space.start, integrality=space.whole, maxiter=wish.generations,
        popsize=wish.population, rng=np.random.default_rng(seed), polish=False, tol=0.0, callback=tell,
    )  # fmt: skip
    if not seen or -result.fun <= _IMPOSSIBLE / 2:
        raise ConfigError("search: no candidate fits the envelope; widen the bounds or the envelope")
    family, camera = space.design(result.x)
    best, _ = evaluate(family, camera, spec.body, wish.envelope, band)
    start, _ = evaluate(spec.family, spec.camera, spec.body, wish.envelope, band)
    if best is None:
        raise ConfigError("search: no candidate fits the envelope; widen the bounds or the envelope")
    if best.score(wish.goal) <= 0.0:
        raise ConfigError(
            "search: no candidate scores above zero on this goal; change the goal or the bounds"
            " (facets of one family lean apart, so its views hardly overlap)"
        )
    table = np.array([[getattr(q, name) for name in GOALS] for q in seen])
    return Found(
        replace(spec, family=family, camera=camera), best, start, table, np.array(history), len(scores)
    )


def evaluate(
    family: Family, camera: CameraSpec, body: Body, envelope: tuple[float, float, float], band: Array
) -> tuple[Qualities | None, float]:
    """Qualities of one candidate; None, with a penalty below zero, where it cannot be."""
    try:
        rig = build(family, camera)
        check_built(rig, family, body)
    except RigError:
        return None, _IMPOSSIBLE
    corners = np.vstack(
        [rig.T_rig_cam[:3, 3], *(m.polygon for m in rig.mirrors.values() if m.polygon is not None)]
    )
    excess = np.ptp(corners, axis=0) / envelope - 1.0
    if excess.max() > _ROUNDING:
        return None, -1.0 - float(excess.max())
    areas = view_areas(rig, body)
    smallest = min(area.solid_angle for area in areas.values())
    if smallest < _SMALLEST_VIEW:
        return None, -1.0 + smallest
    return qualities(rig, areas, band), 0.0


def qualities(rig: Rig, areas: dict[str, Area], band: Array) -> Qualities:
    """What a search weighs, of a rig with its areas, over directions (N, 3) of equal weight."""
    times = np.sum([area.sees(band) for area in areas.values()], axis=0)
    centres = np.array([rig.T_rig_image(name)[:3, 3] for name in rig.views])
    gaps = np.linalg.norm(centres[:, None] - centres[None], axis=2) + np.diag(np.full(len(centres), np.inf))
    nearest = gaps.min(axis=1)
    return Qualities(
        coverage=float(np.mean(times > 0)),
        resolution=rig.camera.fx * math.radians(1.0),
        baseline=float(nearest.mean()) if len(centres) > 1 else 0.0,
        overlap=float(np.mean(times > 1)),
    )


def pareto(candidates: Array) -> NDArray[np.bool_]:
    """Tell which rows (N, D) no other row beats or equals everywhere and beats somewhere."""
    kept = np.ones(len(candidates), dtype=bool)
    for i, row in enumerate(candidates):
        better = (candidates >= row).all(axis=1) & (candidates > row).any(axis=1)
        kept[i] = not better.any()
    return kept


def _band(half: float) -> Array:
    """Directions (N, 3) about the horizon, up to `half` radians above and below."""
    elevation = np.linspace(-half, half, _ROWS)[:, None]
    azimuth = (np.arange(_AZIMUTHS) + 0.5) * math.tau / _AZIMUTHS
    across = np.cos(elevation)
    return np.stack(
        [across * np.sin(azimuth), across * np.cos(azimuth), np.sin(elevation) + 0.0 * azimuth], axis=-1
    ).reshape(-1, 3)


class _Space:
    """The free parameters of a search as a vector."""

    def __init__(self, spec: DesignSpec) -> None:
        assert spec.family is not None
        self._family, self._camera = spec.family, spec.camera
        ranges = {name: getattr(spec.search.bounds, name) for name in spec.search.bounds.__dataclass_fields__}
        unused: tuple[str, ...] = () if spec.family.fold else ("camera_height",)
        if spec.family.depth is None:
            unused += ("depth", "aspect")
        self._free = [
            name for name, ends in ranges.items() if ends and ends[0] != ends[1] and name not in unused
        ]
        for name in self._free:
            if ranges[name][0] > ranges[name][1]:
                raise ConfigError(f"search: bounds of {name} run from {ranges[name][0]:g} down; swap them")
        if not self._free:
            raise ConfigError("search: no parameter is free; give bounds with different ends")
        self.bounds: list[tuple[float, float]] = [ranges[name] for name in self._free]
        self.whole = [name == "faces" for name in self._free]
        self.keeps_lens = self._camera.focal is not None and "focal" not in self._free
        now = [self._camera.focal if n == "focal" else getattr(self._family, n) for n in self._free]
        ends = np.array(self.bounds, dtype=np.float64)
        wished = np.array([ends[i].mean() if v is None else v for i, v in enumerate(now)], dtype=np.float64)
        self.start = np.clip(wished, ends[:, 0], ends[:, 1])

    def design(self, x: Array) -> tuple[Family, CameraSpec]:
        """The family and camera that a vector stands for."""
        values: dict[str, Any] = {name: float(value) for name, value in zip(self._free, x)}
        camera = replace(self._camera, focal=values.pop("focal")) if "focal" in values else self._camera
        if "faces" in values:
            values["faces"] = round(values["faces"])
        return replace(self._family, **values), camera
