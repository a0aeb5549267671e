"""Points on edges: where edges run, and what is found of a point along them counts little."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares
from slam_worlds import bundle_of, folded, in_sight, look, winding_path

from facetcam.geometry import se3
from facetcam.slam.adjustment.bundle import adjust
from facetcam.slam.camera.edges import patch_edges
from facetcam.slam.camera.optics import Optics
from facetcam.slam.camera.patches import PATCH_SIZE
from facetcam.slam.camera.pose import judged_pose, refine_pose
from facetcam.slam.camera.sight import Sights, across, coordinates, seen_edges

Array = NDArray[np.float64]

TRUE = se3.exp([0.02, -0.03, 0.4, 0.3, -0.2, 0.1])
NEAR = TRUE @ se3.exp([0.004, -0.003, 0.005, 0.01, -0.02, 0.01])
SIGMA = 0.5


@pytest.fixture(scope="module")
def optics() -> Optics:
    return Optics(folded(), 8.0)


def drawn(shape: Array) -> NDArray[np.uint8]:
    """A patch with a bright polygon, corners (K, 2) from its middle, sixteen times finer than its pixels."""
    fine = np.full((16 * PATCH_SIZE, 16 * PATCH_SIZE), 60, np.uint8)
    cv2.fillPoly(fine, [np.rint(16 * (shape + PATCH_SIZE / 2)).astype(np.int32)], 180)
    return cv2.resize(fine, (PATCH_SIZE, PATCH_SIZE), interpolation=cv2.INTER_AREA)


def half_plane(angle: float) -> NDArray[np.uint8]:
    """Bright on one side of a line through the middle of a patch."""
    along = np.array([np.cos(angle), np.sin(angle)])
    aside = np.array([-along[1], along[0]])
    return drawn(np.array([-60 * along, 60 * along, 60 * along + 60 * aside, -60 * along + 60 * aside]))


@pytest.mark.parametrize("angle", [0.0, 0.4, 1.2, 1.5708, 2.5])
def test_an_edge_runs_along_the_line(angle: float) -> None:
    jacobian = np.array([[[0.9, 0.3], [-0.2, 1.4]]])
    (edge,) = patch_edges(half_plane(angle)[None], np.zeros((1, 2)), jacobian)
    seen = jacobian[0] @ edge
    assert np.linalg.norm(edge) == pytest.approx(np.sqrt(0.9))
    assert abs(np.cross(seen, [np.cos(angle), np.sin(angle)])) < 0.03 * np.linalg.norm(seen)


def test_a_corner_has_no_edge() -> None:
    square = drawn(np.array([[0.0, 0.0], [60.0, 0.0], [60.0, 60.0], [0.0, 60.0]]))
    np.testing.assert_array_equal(patch_edges(square[None], np.zeros((1, 2)), np.eye(2)[None]), 0.0)


def test_it_is_seen_as_the_image_of_the_edge(optics: Optics) -> None:
    rng = np.random.default_rng(2)
    points = in_sight(optics, TRUE[None], rng, 400)
    seen = look(optics, TRUE, points)
    edges = rng.standard_normal((len(seen.point), 3))
    edges *= rng.uniform(0.1, 0.9, (len(edges), 1)) / np.linalg.norm(edges, axis=1, keepdims=True)
    xyz = points[seen.point]
    along = seen_edges(TRUE, xyz, seen.view, edges, optics)
    np.testing.assert_allclose(np.linalg.norm(along, axis=1), np.linalg.norm(edges, axis=1))
    ahead, back = (
        optics.to_plane(se3.transform(se3.inverse(TRUE), xyz + s * edges), seen.view)[0]
        for s in (1e-6, -1e-6)
    )
    moved = (ahead - back) / np.linalg.norm(ahead - back, axis=1, keepdims=True)
    np.testing.assert_allclose(np.sum(moved * along, axis=1), np.linalg.norm(along, axis=1), atol=1e-5)


def sliding(optics: Optics, rng: np.random.Generator, slide: float) -> Sights:
    """What is seen of points, nine in ten of which were found somewhere along their edges."""
    points = in_sight(optics, TRUE[None], rng, 300)
    seen = look(optics, TRUE, points)
    xyz = points[seen.point]
    edges = rng.standard_normal(xyz.shape)
    edges *= np.sqrt(0.9) / np.linalg.norm(edges, axis=1, keepdims=True)
    edges[rng.random(len(edges)) < 0.1] = 0.0
    along = seen_edges(TRUE, xyz, seen.view, edges, optics)
    plane = (
        seen.plane + rng.normal(0.0, 0.1, seen.plane.shape) + rng.normal(0.0, slide, (len(xyz), 1)) * along
    )
    return Sights(xyz, seen.view, plane, along)


def test_a_pose_does_not_follow_what_slides_along_edges(optics: Optics) -> None:
    seen = sliding(optics, np.random.default_rng(3), 1.5)
    off = [
        np.linalg.norm(se3.log(se3.inverse(TRUE) @ refine_pose(NEAR, s, optics, SIGMA).T_world_rig))
        for s in (Sights.of_corners(*seen[:3]), seen)
    ]
    assert off[1] < 0.4 * off[0] and off[1] < 0.001


@pytest.mark.parametrize(("slide", "least"), [(0.0, 4.5), (1.5, 1.0)])
def test_covariances_are_right_and_where_points_slide_on_the_safe_side(
    optics: Optics, slide: float, least: float
) -> None:
    rng = np.random.default_rng(7)
    squared = []
    for _ in range(60):
        seen = sliding(optics, rng, slide)
        pose = refine_pose(NEAR, seen, optics, SIGMA)
        off = se3.log(se3.inverse(TRUE) @ pose.T_world_rig)
        squared.append(off @ np.linalg.solve(pose.covariance, off))
    assert least < np.mean(squared) < 7.5  # six numbers


def test_residuals_tell_all_that_a_point_has_slid(optics: Optics) -> None:
    rng = np.random.default_rng(8)
    seen = sliding(optics, rng, 1.5)
    pose = judged_pose(TRUE, seen, optics, SIGMA)
    predicted, _ = optics.to_plane(se3.transform(se3.inverse(TRUE), seen.points), seen.views)
    np.testing.assert_allclose(pose.residuals, np.linalg.norm(predicted - seen.plane, axis=1), atol=1e-9)


def test_an_edge_tells_one_coordinate_and_a_corner_two() -> None:
    np.testing.assert_allclose(coordinates(np.array([[0.0, 0.0], [0.6, 0.8]])), [2.0, 1.0])


def test_the_pose_is_where_scipy_finds_the_least_loss(optics: Optics) -> None:
    seen = sliding(optics, np.random.default_rng(4), 0.5)

    def errors(twist: Array) -> Array:
        inside = se3.transform(se3.inverse(NEAR @ se3.exp(twist)), seen.points)
        error = across(seen.edge, optics.to_plane(inside, seen.views)[0] - seen.plane)
        length = np.linalg.norm(error, axis=1)
        return np.asarray(SIGMA * np.sqrt(np.log1p((length / SIGMA) ** 2)))

    theirs = NEAR @ se3.exp(least_squares(errors, np.zeros(6), xtol=1e-12, ftol=1e-14).x)
    ours = refine_pose(NEAR, seen, optics, SIGMA).T_world_rig
    np.testing.assert_allclose(ours, theirs, atol=2e-5)


def test_an_adjustment_does_not_follow_it_either(optics: Optics) -> None:
    rng = np.random.default_rng(5)
    path = winding_path(5)
    exact = bundle_of(optics, path, in_sight(optics, path, rng, 600))
    edges = rng.standard_normal(exact.points.shape)
    edges *= np.sqrt(0.9) / np.linalg.norm(edges, axis=1, keepdims=True)
    edges[rng.random(len(edges)) < 0.2] = 0.0
    known = exact.on_edges(edges, optics)
    along = known.edges
    plane = exact.plane + rng.normal(0.0, 0.1, along.shape) + rng.normal(0.0, 1.5, (len(along), 1)) * along
    off = []
    for told in (exact, known):
        T, *_ = adjust(replace(told, plane=plane), optics, SIGMA, 100, 1e-10)
        off.append(np.linalg.norm(T[:, :3, 3] - path[:, :3, 3]))
    assert off[1] < 0.5 * off[0]
