"""Whether rig and film belong together: worlds seen by one rig and judged by another."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from slam_worlds import folded, in_sight, look, pyramid, single

from facetcam.geometry import se3
from facetcam.rig import Rig
from facetcam.rig.mirrors import Mirror
from facetcam.slam.camera.corner_finder import CornerFinder
from facetcam.slam.camera.optics import Optics
from facetcam.slam.config import SlamConfig
from facetcam.slam.relative_pose.pairs import Pairs
from facetcam.slam.rig_check.check import RigCheck

Array = NDArray[np.float64]


def tilted(rig: Rig, mirror: str, degrees: float) -> Rig:
    """The rig with one mirror turned about its middle."""
    polygon = rig.mirrors[mirror].polygon
    assert polygon is not None
    middle = polygon.mean(axis=0)
    R = se3.exp([*np.radians([degrees, -degrees, 0.0]), 0, 0, 0])[:3, :3]
    turned = Mirror.from_polygon(mirror, (polygon - middle) @ R.T + middle)
    return replace(rig, mirrors={**rig.mirrors, mirror: turned})


def filmed(true: Optics, judge: Optics, T_a_b: Array, rng: np.random.Generator) -> Pairs:
    """Matches that one rig sees, with 0.3 px of noise and a tenth of them wrong, as another takes them."""
    points = in_sight(true, np.array([np.eye(4), T_a_b]), rng, 1500)
    a, b = look(true, np.eye(4), points), look(true, T_a_b, points)
    _, rows_a, rows_b = np.intersect1d(128 * a.point + a.view, 128 * b.point + b.view, return_indices=True)
    views = a.view[rows_a]
    pixels_b = b.pixels[rows_b] + rng.normal(0.0, 0.3, (len(rows_b), 2))
    for view in range(true.n_views):
        wrong = np.flatnonzero((views == view) & (rng.random(len(views)) < 0.1))
        pixels_b[wrong] = pixels_b[np.roll(wrong, 1)]
    return Pairs(views, judge.plane(a.pixels[rows_a], views), judge.plane(pixels_b, views))


def walked_through(pairs: Pairs, walker: Pairs, view: int) -> Pairs:
    """The pairs, but those of one view as if all that it shows moved by itself."""
    kept, walks = pairs.without(np.array([view])), walker.views == view
    return Pairs(
        np.concatenate([kept.views, walker.views[walks]]),
        np.concatenate([kept.plane_a, walker.plane_a[walks]]),
        np.concatenate([kept.plane_b, walker.plane_b[walks]]),
    )


def check(true: Rig, judged: Rig, comparisons: int = 8, walker: int | None = None) -> RigCheck:
    """The check of one rig on what another films, with something that moves before one view."""
    rng = np.random.default_rng(31)
    film, optics = Optics(true, 8.0), Optics(judged, 8.0)
    config = SlamConfig()
    rig_check = RigCheck(optics, config, CornerFinder(optics, config.features))
    for _ in range(comparisons):
        turn, step = rng.normal(0.0, [0.02, 0.02, 0.12]), rng.normal(0.0, 0.15, 3)
        pairs = filmed(film, optics, se3.exp([*turn, *step]), rng)
        if walker is not None:
            T_seen = se3.exp([0.0, 0.0, 0.05, 0.3, 0.0, 0.0])  # steadily across, however the rig moves
            pairs = walked_through(pairs, filmed(film, optics, T_seen, rng), walker)
        rig_check.compare(pairs)
    return rig_check


@pytest.mark.parametrize("rig", [folded(), pyramid()], ids=["folded", "pyramid"])
def test_the_own_rig_fits(rig: Rig) -> None:
    found = check(rig, rig)
    assert found.misfit is not None and found.misfit < 1.15
    assert found.fits and not found.complaint


@pytest.mark.parametrize("rig", [folded(), pyramid()], ids=["folded", "pyramid"])
def test_a_mirror_off_by_two_degrees_is_noticed(rig: Rig) -> None:
    found = check(rig, tilted(rig, rig.views[rig.view_names[1]].mirrors[-1], 1.5))
    assert not found.fits
    assert "does not fit this film" in found.complaint
    assert f"well without {rig.view_names[1]}" in found.complaint


@pytest.mark.parametrize("view", range(4))
def test_someone_who_walks_before_a_view_is_not_the_rigs_fault(view: int) -> None:
    rig = folded()
    found = check(rig, rig, walker=view)
    assert found.misfit is not None and found.misfit > 1.3  # the rig would be blamed
    assert found.fits and not found.complaint
    assert f"the view {rig.view_names[view]} moves by itself" in found.remark


def test_of_two_views_none_can_tell_which_is_wrong() -> None:
    rig = folded()
    two = replace(rig, views={name: rig.views[name] for name in ("front", "left")})
    found = check(two, two, walker=0)
    assert found.complaint and not found.remark


def test_views_that_swapped_places_are_noticed() -> None:
    rig = folded()
    left, right = rig.views["left"], rig.views["right"]
    swapped = replace(rig, views={**rig.views, "left": right, "right": left})
    assert check(rig, swapped).complaint


def test_one_view_or_too_few_frames_leave_the_question_open() -> None:
    assert check(single(), single()).misfit is None
    assert check(folded(), folded(), comparisons=7).misfit is None
