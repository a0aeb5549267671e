"""Build errors: the analytic rules, what calibration removes and what it cannot."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from facetcam.design.spec import Body, Tolerance
from facetcam.design.tolerance import ARCMIN, simulate_builds
from facetcam.errors import ConfigError
from facetcam.rig import Camera, Mirror, Rig, View, presets

Array = NDArray[np.float64]
FOCAL = 1321.0
QUIET = Tolerance(8, 0, 0, 0, 0, 0, 0, 0)


def periscope(turn: float = 0.0, shift: float = 0.0) -> Rig:
    """A camera that looks along +y at a mirror at 45 degrees, 0.1 m before it, which sends the view up."""
    n = np.array([0.0, -math.cos(math.pi / 4 + turn), math.sin(math.pi / 4 + turn)])
    a, b = np.array([1.0, 0, 0]), np.cross(n, [1.0, 0, 0])
    middle = np.array([0.0, 0.1, 0.0]) + shift * n
    corners = [middle + 0.09 * (s * a + t * b) for s, t in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    T = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
    camera = Camera("brown-conrady", 1600, 1200, FOCAL, FOCAL, 799.5, 599.5, (0.0,) * 5)
    return Rig(camera, T, {"m": Mirror.from_polygon("m", corners)}, {"up": View(("m",))})


def test_a_tilt_turns_the_view_by_twice_itself() -> None:
    far = np.array([[0.0, 0.1, 1e6]])
    before, after = (rig.project("up", far)[0] for rig in (periscope(), periscope(ARCMIN)))
    assert np.linalg.norm(after - before) == pytest.approx(0.77, abs=0.005)
    rules = {s.error: s for s in simulate_builds(periscope(), QUIET).sensitivities}
    tilt = rules["mirror tilted by 1'"]
    assert tilt.rule == pytest.approx(0.7686, abs=1e-3)
    assert tilt.pixels == pytest.approx(np.linalg.norm(after - before), rel=0.05)  # samples about the axis


def test_a_shift_moves_points_by_twice_itself_seen_askew() -> None:
    """2 e f / Z times the sine of the angle between the normal and the view: here 45 degrees."""
    point = np.array([[0.0, 0.1, 1.0 - 0.1]])  # Z = 1 m from the virtual camera, 0.1 m below the mirror
    before, after = (rig.project("up", point)[0] for rig in (periscope(), periscope(shift=1e-4)))
    moved = float(np.linalg.norm(after - before))
    assert moved == pytest.approx(2e-4 * FOCAL / 1.0 * math.sin(math.pi / 4), rel=1e-3)
    rules = {s.error: s for s in simulate_builds(periscope(), QUIET).sensitivities}
    shift = rules["mirror moved by 0.1 mm"]
    assert shift.pixels == pytest.approx(moved / 1.1, rel=0.05)  # points 1 m behind the mirror: Z = 1.1 m
    assert shift.pixels <= shift.rule


@pytest.mark.parametrize("field", ["tilt_arcmin", "offset_mm", "camera_mm", "camera_arcmin"])
def test_calibration_removes_what_planes_explain(field: str) -> None:
    found = simulate_builds(
        presets.ryu(), replace(QUIET, builds=3, **{field: 5.0 if "arc" in field else 0.3})
    )
    assert found.before.min() > 0.05
    assert found.removed.min() > 0.999


def test_calibration_cannot_remove_a_bow_and_noise_leaves_its_share() -> None:
    rig = presets.pyramid()
    bowed = simulate_builds(rig, replace(QUIET, bow_um=50.0, tilt_arcmin=5.0, builds=5))
    flat = simulate_builds(rig, replace(QUIET, tilt_arcmin=5.0, builds=5))
    assert flat.after.mean() < 1e-3 < 0.1 < bowed.after.mean() < bowed.before.mean()
    noisy = simulate_builds(rig, replace(QUIET, noise_px=0.1, tilt_arcmin=5.0, builds=5))
    # 40 points a view for about six parameters a view: noise shrinks by sqrt(2 * 6 / 80) of its two axes.
    assert 0.01 < noisy.after.mean() < 0.1


def test_the_mean_build_is_as_bad_as_the_rule_says() -> None:
    """Only tilts: two axes of 10' turn the view by 2 d each; one mirror, so nothing else adds."""
    found = simulate_builds(periscope(), replace(QUIET, builds=300, tilt_arcmin=10.0, depths=(1e5,)), seed=1)
    rms = float(np.sqrt((found.before**2).mean()))
    # How a small turn moves a pinhole's picture: about x, and about an axis at 45 degrees between y and z.
    x, y = np.meshgrid(np.linspace(-800, 800, 99) / FOCAL, np.linspace(-600, 600, 99) / FOCAL)
    about_x = (x * y) ** 2 + (1 + y**2) ** 2
    askew = ((y - 1 - x**2) ** 2 + (x * y + x) ** 2) / 2
    assert rms == pytest.approx(20 * ARCMIN * FOCAL * math.sqrt((about_x + askew).mean()), rel=0.08)


def test_cuts_move_seams_by_similar_triangles() -> None:
    found = simulate_builds(periscope(), replace(QUIET, cut_mm=0.2))
    assert found.seam_shift[0] == pytest.approx(0.2e-3 * FOCAL / 0.1, rel=0.7)


def test_a_seed_gives_the_same_builds_again() -> None:
    given = Tolerance(builds=3)
    one, again, other = (simulate_builds(periscope(), given, seed=s) for s in (1, 1, 2))
    np.testing.assert_array_equal(one.after, again.after)
    assert not np.array_equal(one.before, other.before)


def test_wrong_numbers_are_refused() -> None:
    for wrong in ({"builds": 1}, {"tilt_arcmin": -1.0}, {"depths": ()}, {"depths": (0.0,)}):
        with pytest.raises(ConfigError, match="tolerance"):
            Tolerance(**wrong)  # type: ignore[arg-type]
    facing = Mirror.from_polygon("m", 0.02 * np.array([[-1, -1, 5], [1, -1, 5], [1, 1, 5], [-1, 1, 5]]))
    rig = Rig(periscope().camera, np.eye(4), {"m": facing}, {"back": View(("m",))})
    with pytest.raises(ConfigError, match="too few pixels"):
        simulate_builds(rig, QUIET, body=Body(2.0, 2.0, 1.0))
