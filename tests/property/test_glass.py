"""Mirrors behind glass, against rays followed by Snell's law through every face."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from facetcam.errors import RigError
from facetcam.rig import Camera, Glass, Mirror, Rig, View


def unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v)


def refract(direction: np.ndarray, normal: np.ndarray, ratio: float) -> np.ndarray:
    """Snell's law for a unit direction against a normal that points to where the ray comes from."""
    along = direction + (-normal @ direction) * normal
    sine = ratio * along
    return sine - np.sqrt(1 - sine @ sine) * normal


def meet(origin: np.ndarray, direction: np.ndarray, normal: np.ndarray, offset: float) -> np.ndarray:
    return origin + (offset - normal @ origin) / (normal @ direction) * direction


def snell(
    mirror: Mirror, origin: np.ndarray, direction: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where a ray enters and leaves the glass, and its direction after: in, back, silver, out."""
    toward = -np.sign(direction @ mirror.normal)
    normal, offset = toward * mirror.normal, toward * mirror.offset
    entry = meet(origin, direction, normal, offset)
    inside = refract(direction, normal, 1 / mirror.glass.index)
    silver = meet(entry, inside, normal, offset - mirror.glass.thickness)
    back = inside - 2 * (inside @ normal) * normal
    leave = meet(silver, back, normal, offset)
    return entry, leave, refract(back, -normal, mirror.glass.index)


def random_case(seed: int, count: int) -> tuple[Rig, np.ndarray, list[np.ndarray], np.ndarray, np.ndarray]:
    """A rig with `count` glass mirrors on a pixel's way; where its ray leaves each; last point and way."""
    rng = np.random.default_rng(seed)
    distortion = (rng.uniform(-0.1, 0.1), 0.01, 1e-3, -1e-3, 0.0)
    camera = Camera("brown-conrady", 640, 480, 520.0, 530.0, 315.0, 244.0, distortion)
    R = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    R[:, 0] *= np.linalg.det(R)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, rng.uniform(-1, 1, 3)
    pixel = rng.uniform((60, 60), (580, 420))
    origin, direction = T[:3, 3], R @ camera.ray(pixel)[0]
    mirrors: dict[str, Mirror] = {}
    exits = []
    for i in range(count):
        normal = unit(rng.normal(size=3))
        while abs(normal @ direction) < 0.3:
            normal = unit(rng.normal(size=3))
        foot = origin + rng.uniform(0.15, 0.5) * direction
        glass = Glass(rng.uniform(0.001, 0.012), rng.uniform(1.3, 1.9))
        mirrors[f"m{i}"] = replace(Mirror.from_plane("plane", normal, float(normal @ foot)), glass=glass)
        _, origin, direction = snell(mirrors[f"m{i}"], origin, direction)
        exits.append(origin)
    return Rig(camera, T, mirrors, {"view": View(tuple(mirrors))}), pixel, exits, origin, direction


@settings(max_examples=80, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 3), depth=st.floats(0.02, 30.0))
def test_rays_and_pixels_follow_snell(seed: int, count: int, depth: float) -> None:
    rig, pixel, _, leaves, direction = random_case(seed, count)
    origin, ray = (a[0] for a in rig.ray("view", [pixel]))
    np.testing.assert_allclose(ray, direction, atol=1e-9)
    assert np.linalg.norm(np.cross(leaves - origin, ray)) < 1e-9
    point = leaves + depth * direction
    thin = Rig(
        rig.camera, rig.T_rig_cam, {n: replace(m, glass=None) for n, m in rig.mirrors.items()}, rig.views
    )
    if not rig.sees("view", [pixel])[0]:  # another of the unbounded mirrors lies on the way
        return
    back, visible = rig.project("view", [point])
    first = rig.project("view", [leaves - 1e-3 * direction])[1][0]
    assert not first
    if visible[0]:
        np.testing.assert_allclose(back[0], pixel, rtol=0, atol=1e-6)
        assert np.abs(thin.project("view", [point])[0] - back).max() > 1e-3


def one_mirror(glass: Glass | None) -> Rig:
    square = [[-0.3, 0.4, -0.3], [0.2, 0.4, -0.3], [0.2, 0.4, 0.3], [-0.3, 0.4, 0.3]]
    camera = Camera("brown-conrady", 640, 480, 500.0, 500.0, 319.5, 239.5, (0.0,) * 5)
    forward = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
    mirror = replace(Mirror.from_polygon("m", square), glass=glass)
    return Rig(camera, forward, {"m": mirror}, {"m": View(("m",)), "direct": View(())})


def test_a_ray_that_reaches_the_edge_of_the_glass_is_lost() -> None:
    thick = one_mirror(Glass(0.02, 1.5))
    x = np.linspace(320.0, 639.0, 640)
    pixels = np.column_stack([x, np.full_like(x, 239.5)])
    slope = (x - 319.5) / 500.0
    sine = slope / np.hypot(1, slope)
    leaves = 0.4 * slope + 2 * 0.02 * sine / np.sqrt(1.5**2 - sine**2)
    np.testing.assert_array_equal(thick.sees("m", pixels), leaves < 0.2)
    np.testing.assert_array_equal(one_mirror(None).sees("m", pixels), 0.4 * slope < 0.2)
    between = (leaves >= 0.2) & (0.4 * slope < 0.2)
    assert between.sum() > 10
    assert not thick.sees("direct", pixels[between]).any()


def test_the_stand_in_centre_fits_the_middle_of_the_view() -> None:
    rig = one_mirror(Glass(0.006))
    centre = rig.T_rig_image("m")[:3, 3]
    np.testing.assert_allclose(centre, [0, 0.8 + 2 * 0.006 / 1.52, 0], atol=2e-5)
    origins, _ = rig.ray("m", [[319.5, 239.5], [20.0, 239.5]])
    np.testing.assert_allclose(origins[0], centre, atol=2e-5)
    assert origins[1, 1] < centre[1] - 2e-4


def test_no_thickness_is_a_first_surface_mirror_bit_by_bit() -> None:
    points = np.random.default_rng(3).uniform((-0.3, -2, -0.3), (0.3, 0.3, 0.3), (200, 3))
    for a, b in zip(one_mirror(Glass(0.0)).project("m", points), one_mirror(None).project("m", points)):
        np.testing.assert_array_equal(a, b)


def test_glass_is_written_and_read(tmp_path: Path) -> None:
    rig = one_mirror(Glass(0.0061, 1.517))
    rig.save(tmp_path / "rig.yaml")
    again = Rig.load(tmp_path / "rig.yaml")
    assert again.mirrors["m"].glass == Glass(0.0061, 1.517)
    assert again.digest == rig.digest != one_mirror(None).digest


@pytest.mark.parametrize(
    ("glass", "said"),
    [
        ("{thickness: -0.001}", "mirror 'm': glass: the thickness -0.001 must be 0 to 0.1 metres"),
        ("{thickness: 4, index: 1.5}", "the thickness 4 must be"),
        ("{thickness: 0.004, index: 1.0}", "refractive index 1 must be above 1"),
        ("{thickness: 0.004, indx: 1.5}", "did you mean 'index'?"),
        ("{index: 1.5}", "missing key 'thickness'"),
        ("4", "mirror 'm': glass: expected keys with values"),
    ],
)
def test_wrong_glass_is_one_line(tmp_path: Path, glass: str, said: str) -> None:
    path = tmp_path / "rig.yaml"
    one_mirror(Glass(0.005)).save(path)
    text = path.read_text()
    assert "glass: {thickness: 0.005, index: 1.52}" in text
    path.write_text(text.replace("{thickness: 0.005, index: 1.52}", glass))
    with pytest.raises(RigError, match=r"^[^\n]*$") as caught:
        Rig.load(path)
    assert said in str(caught.value)
