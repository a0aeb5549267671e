"""Rigid motions, reflections and triangulation against closed forms and SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from facetcam.errors import FacetcamError
from facetcam.geometry import reflection, se3
from facetcam.geometry.triangulation import triangulate_two_rays

RNG = np.random.default_rng(4)


@pytest.mark.parametrize("scale", [1e-9, 1e-5, 0.1, 1.0, 3.0])
def test_exp_is_the_matrix_exponential_and_log_undoes_it(scale: float) -> None:
    for _ in range(20):
        xi = RNG.normal(size=6)
        xi[:3] *= scale / np.linalg.norm(xi[:3])
        generator = np.zeros((4, 4))
        generator[:3, :3], generator[:3, 3] = se3.skew(xi[:3]), xi[3:]
        np.testing.assert_allclose(se3.exp(xi), expm(generator), atol=1e-12)
        np.testing.assert_allclose(se3.log(se3.exp(xi)), xi, atol=1e-9)


def test_inverse_undoes_proper_and_mirrored_motions() -> None:
    T = se3.exp(RNG.normal(size=6)) @ reflection.reflection([0.6, 0.0, 0.8], 0.3)
    stack = np.stack([T, T @ T])
    np.testing.assert_allclose(se3.inverse(stack) @ stack, np.stack([np.eye(4)] * 2), atol=1e-12)


def test_quaternions_go_there_and_back_with_one_sign() -> None:
    for _ in range(20):
        T = se3.exp(RNG.normal(size=6))
        quaternion = se3.to_quaternion_xyzw(T)
        assert quaternion[3] >= 0
        np.testing.assert_allclose(se3.from_quaternion_xyzw(-3.0 * quaternion, T[:3, 3]), T, atol=1e-12)


@pytest.mark.parametrize(
    ("R", "message"),
    [
        (np.diag([-1.0, 1.0, 1.0]), "a mirror image"),
        (2.0 * np.eye(3), "not a rotation"),
        (np.full((3, 3), np.nan), "finite 3x3"),
        (np.eye(4), "finite 3x3"),
    ],
)
def test_what_is_no_rotation_is_refused_by_name(R: np.ndarray, message: str) -> None:
    with pytest.raises(FacetcamError, match=f"pose of the lens.*{message}"):
        se3.assert_proper_rotation(R, "pose of the lens")


def test_a_reflection_keeps_its_plane_and_undoes_itself() -> None:
    normal = np.array([2.0, -1.0, 2.0]) / 3.0
    S = reflection.reflection(normal, 0.7)
    on_plane = 0.7 * normal + np.cross(normal, RNG.normal(size=(10, 3)))
    np.testing.assert_allclose(se3.transform(S, on_plane), on_plane, atol=1e-12)
    np.testing.assert_allclose(se3.transform(S, on_plane + 0.2 * normal), on_plane - 0.2 * normal, atol=1e-12)
    np.testing.assert_allclose(S @ S, np.eye(4), atol=1e-12)
    assert np.linalg.det(S) == pytest.approx(-1.0)


def test_a_chain_applies_its_first_reflection_first() -> None:
    floor, wall = reflection.reflection([0, 0, 1], 0.0), reflection.reflection([0.6, 0, 0.8], 1.0)
    point = np.array([[0.3, -0.2, 0.9]])
    step_by_step = se3.transform(wall, se3.transform(floor, point))
    np.testing.assert_allclose(se3.transform(reflection.chain([floor, wall]), point), step_by_step)
    assert np.linalg.det(reflection.chain([floor, wall])) == pytest.approx(1.0)


def test_plane_of_polygon_follows_the_order_of_its_corners() -> None:
    corners = np.array([[0, 0, 2.0], [1, 0, 2], [1, 1, 2], [0, 1, 2.001]])
    normal, offset, flatness = reflection.plane_of_polygon(corners)
    assert normal[2] > 0.999
    assert reflection.plane_of_polygon(corners[::-1])[0][2] < -0.999
    assert offset == pytest.approx(2.0, abs=2e-3)
    assert flatness == pytest.approx(0.00025, rel=0.01)
    with pytest.raises(FacetcamError, match="no area"):
        reflection.plane_of_polygon([[0, 0, 0], [1, 1, 1], [2, 2, 2.0]])


def test_two_rays_meet_in_their_point() -> None:
    points = RNG.uniform(-3, 3, (50, 3))
    origins = RNG.uniform(-1, 1, (2, 50, 3))
    offsets = points - origins
    distances = np.linalg.norm(offsets, axis=2)
    a, b = offsets / distances[..., None]
    found, distance_a, distance_b, angle = triangulate_two_rays(origins[0], a, origins[1], b)
    np.testing.assert_allclose(found, points, atol=1e-9)
    np.testing.assert_allclose([distance_a, distance_b], distances, atol=1e-9)
    np.testing.assert_allclose(np.cos(angle), np.einsum("ij,ij->i", a, b), atol=1e-12)


def test_parallel_rays_meet_at_infinity_without_a_warning() -> None:
    along = np.array([[0.0, 0.0, 1.0]])
    _, distance_a, distance_b, angle = triangulate_two_rays(np.zeros((1, 3)), along, np.ones((1, 3)), along)
    assert np.isinf(distance_a[0]) and np.isinf(distance_b[0])
    assert angle[0] == 0.0
