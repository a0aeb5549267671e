"""The search: better than where it began, inside its envelope, and the same again from a seed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from facetcam.design.family import make_rig
from facetcam.design.search import pareto, search
from facetcam.design.spec import Bounds, DesignSpec, Family, Goal, Search, read_spec
from facetcam.errors import ConfigError
from facetcam.rig import NO_VIEW

QUICK = Search(generations=8, population=5)


def horizon_by_pixels(spec: DesignSpec) -> float:
    """Share of the azimuths of the band about the horizon that traced pixels see, in bins of a degree."""
    rig = make_rig(spec)
    labels = rig.labels()[::2, ::2]
    v, u = np.nonzero(labels != NO_VIEW)
    directions = np.empty((len(u), 3))
    for index, name in enumerate(rig.views):
        own = labels[v, u] == index
        directions[own] = rig.ray(name, 2.0 * np.column_stack([u[own], v[own]]))[1]
    elevation = np.degrees(np.arcsin(directions[:, 2]))
    azimuth = np.degrees(np.arctan2(directions[:, 0], directions[:, 1])).astype(int) % 360
    rows = [np.abs(elevation - level) < 0.5 for level in (-10, -5, 0, 5, 10)]
    return float(np.mean([len(np.unique(azimuth[row])) / 360 for row in rows]))


def test_it_beats_the_paper_s_rig_on_its_own_goal() -> None:
    spec = replace(read_spec("preset:ryu"), search=QUICK)
    found = search(spec, seed=0)
    assert found.start is not None
    assert found.best.coverage > 1.2 * found.start.coverage
    assert found.history.tolist() == sorted(found.history)
    assert found.best.coverage == pytest.approx(found.candidates[:, 0].max(), abs=1e-12)
    rig = make_rig(found.spec)
    corners = np.vstack([m.polygon for m in rig.mirrors.values() if m.polygon is not None])
    assert np.all(np.ptp(corners, axis=0) <= np.array(spec.search.envelope) + 1e-9)
    # Judged by rays, without the areas that the search believed (they also count the camera's body).
    assert horizon_by_pixels(found.spec) > 1.1 * horizon_by_pixels(spec)
    again = search(spec, seed=0)
    assert again.spec.family == found.spec.family


@pytest.mark.parametrize(("goal", "quality"), [("baseline", "baseline"), ("resolution", "resolution")])
def test_each_goal_gets_its_own(goal: str, quality: str) -> None:
    weights = {"coverage": 0.0, goal: 1.0}
    bounds = replace(Bounds(), focal=(900.0, 1400.0))
    spec = replace(
        read_spec("preset:ryu"), search=replace(QUICK, goal=Goal(**weights), bounds=bounds, generations=4)
    )
    found = search(spec)
    assert found.start is not None
    assert getattr(found.best, quality) >= getattr(found.start, quality)


def test_it_says_what_it_cannot_do() -> None:
    with pytest.raises(ConfigError, match="give a family"):
        search(DesignSpec(rig="preset:table"))
    tiny = Search(envelope=(0.01, 0.01, 0.01), generations=1, population=2)
    with pytest.raises(ConfigError, match="no candidate fits"):
        search(DesignSpec(family=Family(), search=tiny))
    nothing = Bounds(*(None,) * 8)
    with pytest.raises(ConfigError, match="no parameter is free"):
        search(DesignSpec(family=Family(), search=Search(bounds=nothing)))
    upside_down = replace(Bounds(), radius=(0.09, 0.03))
    with pytest.raises(ConfigError, match="swap them"):
        search(DesignSpec(family=Family(), search=Search(bounds=upside_down)))
    sharp = replace(read_spec("preset:ryu"), search=Search(goal=Goal(coverage=0.0, resolution=1.0)))
    with pytest.raises(ConfigError, match="the lens alone decides"):
        search(sharp)
    with pytest.raises(ConfigError, match="one of them above zero"):
        Goal(coverage=0.0)


@settings(max_examples=30, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 5), st.integers(0, 5)), min_size=1, max_size=20))
def test_pareto_keeps_exactly_what_nothing_beats(rows: list[tuple[int, int]]) -> None:
    table = np.array(rows, dtype=float)
    kept = pareto(table)
    for row, is_kept in zip(rows, kept):
        beaten = any(o[0] >= row[0] and o[1] >= row[1] and o != row for o in rows)
        assert is_kept == (not beaten)


def test_a_goal_that_no_candidate_gains_on_is_said() -> None:
    wish = Search(goal=Goal(0.0, overlap=1.0), generations=1, population=2)
    with pytest.raises(ConfigError, match="no candidate scores above zero on this goal"):
        search(replace(read_spec("preset:ryu"), search=wish))
