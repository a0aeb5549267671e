"""Corners of squares whose edges a lens bends are found where they are."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from facetcam.calibration.bent_edges import drawn_aside
from facetcam.calibration.corners import radius_of, refine
from facetcam.geometry import se3
from facetcam.rig import Camera

Array = NDArray[np.float64]
SIZE, FINER, SQUARE = (640, 480), 6, 0.08
LENSES = {
    "barrel": Camera("brown-conrady", *SIZE, 500.0, 500.0, 319.5, 239.5, (-0.25, 0.06, 0.0, 0.0, 0.0)),
    "pincushion": Camera("brown-conrady", *SIZE, 500.0, 500.0, 319.5, 239.5, (0.2, 0.0, 0.0, 0.0, 0.0)),
    "fisheye": Camera("kannala-brandt", *SIZE, 300.0, 300.0, 319.5, 239.5, (0.02, -0.004, 0.0, 0.0)),
}


def seen(camera: Camera, T: Array) -> NDArray[np.uint8]:
    """A chessboard without end, seen through the lens: the mean over each pixel."""
    width, height = SIZE
    v, u = np.mgrid[0 : FINER * height, 0 : FINER * width]
    rays = camera.ray(np.stack([(u.ravel() + 0.5) / FINER - 0.5, (v.ravel() + 0.5) / FINER - 0.5], axis=1))
    H = np.linalg.inv(T[:3, [0, 1, 3]])
    x, y, w = H @ rays.T
    white = (np.floor(x / w / SQUARE) + np.floor(y / w / SQUARE)) % 2 == 0
    fine = np.where(white, 220.0, 30.0).reshape(height, FINER, width, FINER).mean(axis=(1, 3))
    return np.rint(cv2.GaussianBlur(fine, (0, 0), 0.7)).astype(np.uint8)


@pytest.mark.parametrize("name", LENSES)
def test_bent_edges_draw_corners_aside_as_foretold(name: str) -> None:
    camera = LENSES[name]
    T = se3.exp(np.array([0.25, -0.3, 0.4, 0.01, 0.02, 0.4]))

    def project(points: Array) -> Array:
        return camera.project(se3.transform(T, points))[0]

    y, x = np.mgrid[-4:5, -4:5]
    points = SQUARE * np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    sides = [
        np.linalg.norm(project(points + side) - project(points), axis=1) for side in SQUARE * np.eye(3)[:2]
    ]
    square = np.minimum(*sides)
    pixels, accepted = refine(seen(camera, T), project(points), square)
    assert accepted.sum() >= 12
    off = (pixels - project(points))[accepted]
    aside = drawn_aside(project, points, SQUARE, radius_of(square))[accepted]
    assert np.sum(off * aside) / np.sum(aside**2) == pytest.approx(1.0, abs=0.1)
    assert np.sqrt(np.mean((off - aside) ** 2)) < 0.6 * np.sqrt(np.mean(off**2))


def test_straight_edges_draw_corners_nowhere() -> None:
    camera = Camera("brown-conrady", *SIZE, 500.0, 500.0, 319.5, 239.5, (0.0,) * 5)
    T = se3.exp(np.array([0.25, -0.3, 0.4, 0.01, 0.02, 0.4]))
    points = SQUARE * np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0]])

    def project(points: Array) -> Array:
        return camera.project(se3.transform(T, points))[0]

    assert np.abs(drawn_aside(project, points, SQUARE, np.full(3, 15.0))).max() < 1e-9
