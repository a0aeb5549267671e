"""The scale of a map tested by sightings in other views, against worlds whose scale is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from slam_worlds import bundle_of, folded, in_sight

from facetcam.slam.adjustment.bundle import Bundle
from facetcam.slam.camera.optics import Optics
from facetcam.slam.scale.evidence import Evidence, home_views, scale_evidence

OPTICS = Optics(folded(), 8.0)
# The rig does not turn: its lever arms then scale with the map, whose scale may be wrong without a trace.
PATH = np.tile(np.eye(4), (8, 1, 1))
PATH[:, :2, 3] = np.linspace((0.0, 0.0), (0.3, 1.2), 8)
SIGMA = 0.5

World = tuple[Bundle, Bundle, NDArray[np.int8]]


def rows_of(bundle: Bundle, rows: NDArray[np.generic]) -> Bundle:
    """Some of its observations."""
    return replace(bundle, **{n: getattr(bundle, n)[rows] for n in ("frame", "view", "point", "plane")})


def world(seed: int, factor: float, count: int = 6000) -> World:
    """A map that is `factor` too large, and what else was seen of its points from which home views."""
    rng = np.random.default_rng(seed)
    points = in_sight(OPTICS, PATH, rng, count)
    bundle = bundle_of(OPTICS, PATH, points, rng.normal(0.0, SIGMA, (60000, 2)))
    home = home_views(bundle.view, bundle.point, len(bundle.points))[bundle.point]
    bundle.T_world_rig[:, :3, 3] *= factor
    bundle.points = factor * bundle.points
    away = home != bundle.view
    return rows_of(bundle, ~away), rows_of(bundle, away), home[away]


@pytest.mark.parametrize("factor", [0.55, 0.82, 0.95, 1.0, 1.1, 1.2, 1.8])
def test_other_views_tell_by_how_much_a_map_is_too_large(factor: float) -> None:
    found = scale_evidence(*world(1, factor), OPTICS, SIGMA)
    assert found.points > 30 and found.sigma < 0.02
    assert abs(found.stretch + np.log(factor)) < 3.0 * found.sigma
    assert np.isfinite(found.tested(0.001)) == (factor == 1.0)  # a map that is sure of itself is denied
    assert (found.ahead > 10.0) == (factor != 1.0)


def test_few_sightings_that_agree_make_another_scale_far_likelier() -> None:
    """Twenty points, as a young map may have them."""
    whole, away, home = world(6, 0.7)
    few = np.isin(away.point, np.unique(away.point)[:: len(np.unique(away.point)) // 20])
    found = scale_evidence(whole, rows_of(away, few), home[few], OPTICS, SIGMA)
    assert 8 <= found.points < 30
    assert abs(found.stretch + np.log(0.7)) < 3.0 * found.sigma and found.ahead > 10.0


def test_a_third_of_wrong_sightings_does_not_change_it() -> None:
    whole, away, home = world(2, 1.1)
    rng = np.random.default_rng(3)
    wrong, right = rng.random(len(away.frame)) < 0.33, away.plane.copy()
    away.plane[wrong] += rng.uniform(-60.0, 60.0, (int(wrong.sum()), 2))
    found = scale_evidence(whole, away, home, OPTICS, SIGMA)
    assert abs(found.stretch + np.log(1.1)) < 3.0 * found.sigma
    far = np.linalg.norm(away.plane - right, axis=1) > 20.0
    assert found.agrees[~wrong].mean() > 0.5 and found.agrees[far].mean() < 0.1


def test_sightings_by_chance_say_nothing() -> None:
    whole, away, home = world(4, 1.0)
    away.plane += np.random.default_rng(5).uniform(-80.0, 80.0, away.plane.shape)
    for some in (slice(None, None, 10), slice(0, 0)):
        rows = np.arange(len(home))[some]
        found = scale_evidence(whole, rows_of(away, rows), home[rows], OPTICS, SIGMA)
        assert found.sigma == np.inf and not found.agrees.any()
        assert found.tested(0.001) == np.inf
        assert 0.003 < found.tested(0.003, earlier=0.004) < 0.005


def test_the_stretch_scatters_over_noisy_worlds_as_its_sigma_says() -> None:
    found = [scale_evidence(*world(seed, 1.0, count=2000), OPTICS, SIGMA) for seed in range(10, 30)]
    error = np.array([e.stretch / e.sigma for e in found])
    assert 0.3 < np.sqrt(np.mean(error**2)) < 1.3
    assert np.mean(np.abs(error) < 3.0) > 0.95


def test_what_is_believed_of_a_scale_lies_between_what_map_and_test_know() -> None:
    agreeing = Evidence(0.004, 0.0018, 50, np.ones(50, dtype=bool))  # which errs by 0.003 in a real map
    assert 0.004 < agreeing.tested(0.004) < 0.005
    assert 0.0001 < agreeing.tested(0.0001) < 0.0004  # noise alone is never all
    assert agreeing.tested(np.inf) == np.inf
    assert replace(agreeing, stretch=0.014).tested(0.004) > 0.01  # more than noise explains
    assert replace(agreeing, stretch=0.016).tested(0.004) == np.inf
    assert replace(agreeing, stretch=0.016).tested(0.02) < 0.021  # it never knew better


def test_home_views_are_those_that_see_most() -> None:
    view, point = np.array([0, 1, 1, 2, 0]), np.array([0, 0, 0, 2, 2])
    assert home_views(view, point, 4).tolist() == [1, -1, 0, -1]
