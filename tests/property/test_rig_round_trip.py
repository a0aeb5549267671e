"""Random rigs: pixel, ray, mirrors, point and pixel again, against a slow tracer that shares no code."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from facetcam.rig import Camera, Mirror, Rig, View

SIZE = (640, 480)
Triangle = tuple[np.ndarray, np.ndarray, np.ndarray]


def unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v)


def random_camera(rng: np.random.Generator, model: str) -> Camera:
    width, height = SIZE
    cx, cy = width / 2 + rng.uniform(-20, 20), height / 2 + rng.uniform(-20, 20)
    if model == "brown-conrady":
        distortion = (rng.uniform(-0.15, 0.1), rng.uniform(-0.02, 0.05), *rng.uniform(-1e-3, 1e-3, 2), 0.005)
        focal = rng.uniform(350, 900)
    else:
        distortion = (*rng.uniform(0.0, 0.02, 2), -1e-4, 0.0)
        focal = rng.uniform(110, 300)  # up to more than 180 degrees across
    return Camera(model, width, height, focal, focal * rng.uniform(0.98, 1.02), cx, cy, distortion)


def random_mirror(
    rng: np.random.Generator, origin: np.ndarray, direction: np.ndarray, bounded: bool
) -> Mirror:
    """A mirror that the ray meets at 0.1 to 0.5 m and at no less than about 25 degrees."""
    centre = origin + rng.uniform(0.1, 0.5) * direction
    while True:
        normal = unit(rng.normal(size=3))
        if abs(normal @ direction) > 0.4:
            break
    if not bounded:
        return Mirror.from_plane("plane", normal, float(normal @ centre))
    a = unit(np.cross(normal, [0.3, 0.5, 0.8]))
    b = np.cross(normal, a)
    corners = int(rng.integers(3, 7))
    angles = (np.arange(corners) + rng.uniform(-0.3, 0.3, corners)) * 2 * np.pi / corners
    ring = np.cos(angles)[:, None] * a * rng.uniform(0.05, 0.3) + np.sin(angles)[:, None] * b * rng.uniform(
        0.05, 0.3
    )
    return Mirror.from_polygon("polygon", centre + ring)


def random_rig(seed: int, count: int, model: str) -> tuple[Rig, np.ndarray]:
    """A rig whose one view meets `count` mirrors on the way of one pixel; and that pixel."""
    rng = np.random.default_rng(seed)
    camera = random_camera(rng, model)
    R = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    R[:, 0] *= np.linalg.det(R)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, rng.uniform(-1, 1, 3)
    pixel = rng.uniform((20, 20), (620, 460))
    origin, direction = T[:3, 3], R @ camera.ray(pixel)[0]
    mirrors: dict[str, Mirror] = {}
    for i in range(count):
        mirror = random_mirror(rng, origin, direction, bounded=rng.random() < 0.7)
        mirrors[f"m{i}"] = mirror
        distance = (mirror.offset - mirror.normal @ origin) / (mirror.normal @ direction)
        origin = origin + distance * direction
        direction = direction - 2 * (direction @ mirror.normal) * mirror.normal
    return Rig(camera, T, mirrors, {"view": View(tuple(mirrors))}), pixel


def triangles(mirror: Mirror) -> list[Triangle]:
    """The mirror as a fan of triangles; an unbounded one as two of enormous size."""
    if mirror.polygon is not None:
        corners = list(mirror.polygon)
    else:
        a = unit(np.cross(mirror.normal, [0.3, 0.5, 0.8]))
        b = np.cross(mirror.normal, a)
        foot = mirror.offset * mirror.normal
        corners = [foot + 1e4 * (x * a + y * b) for x, y in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    return [(corners[0], corners[i], corners[i + 1]) for i in range(1, len(corners) - 1)]


def slow_hit(triangle: Triangle, origin: np.ndarray, direction: np.ndarray) -> float:
    """Distance to a triangle by Moeller and Trumbore (1997), inf for a miss."""
    v0, v1, v2 = triangle
    e1, e2 = v1 - v0, v2 - v0
    p = np.cross(direction, e2)
    determinant = e1 @ p
    if determinant == 0:
        return np.inf
    s = origin - v0
    u, v = s @ p / determinant, direction @ np.cross(s, e1) / determinant
    t = e2 @ np.cross(s, e1) / determinant
    return t if u >= 0 and v >= 0 and u + v <= 1 and t > 1e-7 else np.inf


def slow_trace(rig: Rig, pixel: np.ndarray) -> tuple[list[str], np.ndarray, np.ndarray, float]:
    """Mirrors met over one bounce more than the chain, and the ray after the chain with its free length."""
    chain = rig.views["view"].mirrors
    origin, direction = rig.T_rig_cam[:3, 3], rig.T_rig_cam[:3, :3] @ rig.camera.ray(pixel)[0]
    met: list[str] = []
    while True:
        hits = {
            name: min(slow_hit(t, origin, direction) for t in triangles(m)) for name, m in rig.mirrors.items()
        }
        name = min(hits, key=lambda n: hits[n]) if hits else ""
        free = hits.get(name, np.inf)
        if len(met) == len(chain) or not np.isfinite(free):
            return met, origin, direction, free
        met.append(name)
        v0, v1, v2 = triangles(rig.mirrors[name])[0]
        normal = unit(np.cross(v1 - v0, v2 - v0))
        origin = origin + free * direction
        direction = direction - 2 * (direction @ normal) * normal


@settings(max_examples=80, deadline=None, derandomize=True)
@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(0, 3),
    model=st.sampled_from(["brown-conrady", "kannala-brandt"]),
    depth=st.floats(0.05, 50.0),
)
def test_pixel_to_point_and_back(seed: int, count: int, model: str, depth: float) -> None:
    rig, pixel = random_rig(seed, count, model)
    met, origin, direction, free = slow_trace(rig, pixel)
    reached = tuple(met) == rig.views["view"].mirrors
    point = origin + min(depth, 0.5 * free) * direction
    back, visible = rig.project("view", [point])
    assert visible[0] == reached
    if reached:
        np.testing.assert_allclose(back[0], pixel, rtol=0, atol=1e-6)
        centre, ray = (a[0] for a in rig.ray("view", [pixel]))
        miss = np.cross(point - centre, ray)
        assert np.linalg.norm(miss) < 1e-9 * (1 + np.linalg.norm(point - centre))
        if np.isfinite(free):
            behind_obstacle = origin + (free * 1.001 + 1e-6) * direction
            assert not rig.project("view", [behind_obstacle])[1][0]
        if count:
            before_last_mirror = origin - 1e-3 * direction
            assert not rig.project("view", [before_last_mirror])[1][0]


@settings(max_examples=25, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 3))
def test_sees_agrees_with_the_slow_tracer(seed: int, count: int) -> None:
    rig, pixel = random_rig(seed, count, "brown-conrady")
    rng = np.random.default_rng(seed)
    pixels = np.clip(pixel + rng.normal(scale=60, size=(30, 2)), 0, (639, 479))
    expected = []
    for p in pixels:
        met, origin, direction, _ = slow_trace(rig, p)
        hits = {n: min(slow_hit(t, origin, direction) for t in triangles(m)) for n, m in rig.mirrors.items()}
        nearest = min(hits, key=lambda n: hits[n])
        hidden = np.isfinite(hits[nearest]) and rig.mirrors[nearest].polygon is not None
        expected.append(tuple(met) == rig.views["view"].mirrors and not hidden)
    np.testing.assert_array_equal(rig.sees("view", pixels), expected)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(0, 3))
def test_the_proper_virtual_camera_sees_the_same_pixels(seed: int, count: int) -> None:
    rig, pixel = random_rig(seed, count, "brown-conrady")
    T = rig.T_rig_view("view")
    assert np.linalg.det(T[:3, :3]) > 0
    assert rig.is_flipped("view") == (count % 2 == 1)
    centre, ray = (a[0] for a in rig.ray("view", [pixel]))
    in_view = np.linalg.inv(T) @ [*(centre + 3.0 * ray), 1.0]
    seen, valid = rig.view_camera("view").project([in_view[:3]])
    expected = [SIZE[0] - 1 - pixel[0], pixel[1]] if count % 2 else pixel
    assert valid[0]
    np.testing.assert_allclose(seen[0], expected, atol=1e-6)
