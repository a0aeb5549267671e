"""Corners fitted to drawn ones at exact places: each pixel is the mean of 64 samples of the pattern."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from facetcam.calibration.corners import refine
from facetcam.calibration.saddle_fit import fit_saddles

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

TILE, FINER = 64, 8
SIDE = 50.0  # pixels a square


def drawn(
    count: int,
    seed: int,
    square_on: bool = False,
    blur: float = 0.6,
    noise: float = 2.0,
    gamma: float = 1.0,
    slope: float = 0.0,
    smear: int = 0,
) -> tuple[Image, Array]:
    """Corners of a ChArUco board in tiles, one below the other: image, and where they are (count, 2)."""
    random = np.random.default_rng(seed)
    at = (np.arange(TILE * FINER) + 0.5) / FINER - 0.5
    x, y = np.meshgrid(at, at)
    tiles, truth = [], []
    for index in range(count):
        corner = TILE / 2 + random.uniform(-0.5, 0.5, 2)
        turn = random.normal(0, 0.02) if square_on else random.uniform(0, np.pi)
        sides = turn + np.array([0.0, np.pi / 2 + (0.0 if square_on else random.uniform(-0.5, 0.5))])
        to_board = np.linalg.inv(SIDE * np.array([np.cos(sides), np.sin(sides)]))
        u, v = np.einsum("ij,jhw->ihw", to_board, np.stack([x - corner[0], y - corner[1]]))
        dark = (np.floor(u) + np.floor(v)) % 2 == 0
        inner = (np.abs(u % 1 - 0.5) < 0.375) & (np.abs(v % 1 - 0.5) < 0.375)  # the markers
        light = (np.where(dark | inner, 35.0, 225.0) / 255) ** gamma * (1 + slope * (y - corner[1]) / TILE)
        light = cv2.GaussianBlur(light, (0, 0), blur * FINER)
        if smear:
            light = cv2.filter2D(
                light, -1, np.eye(smear * FINER + 1) / (smear * FINER + 1)
            )  # odd: about its middle
        pixels = light.reshape(TILE, FINER, TILE, FINER).mean(axis=(1, 3))
        tiles.append(255 * pixels ** (1 / gamma) + noise * random.standard_normal((TILE, TILE)))
        truth.append(corner + np.array([0.0, index * TILE]))
    return np.clip(np.rint(np.concatenate(tiles)), 0, 255).astype(np.uint8), np.array(truth)


def found(image: Image, truth: Array) -> Array:
    """Errors (N, 2) of the corners from starts half a pixel away."""
    start = truth + np.random.default_rng(1).uniform(-0.35, 0.35, truth.shape)
    pixels, accepted = refine(image, start, np.full(len(truth), SIDE))
    assert accepted.all()
    return np.asarray(pixels - truth)


CASES: dict[str, dict[str, float]] = {
    "usual": {}, "sharp": {"blur": 0.3}, "out of focus": {"blur": 1.2}, "noise": {"noise": 6.0},
    "tone curve": {"gamma": 2.2}, "shade": {"slope": 0.15}, "moved": {"smear": 2},
}  # fmt: skip


@pytest.mark.parametrize("case", list(CASES))
def test_corners_are_good_to_hundredths_of_a_pixel(case: str) -> None:
    image, truth = drawn(25, 3, **CASES[case])  # type: ignore[arg-type]
    off = found(image, truth)
    gradients = cv2.cornerSubPix(
        image, truth.astype(np.float32), (7, 7), (-1, -1), (cv2.TERM_CRITERIA_COUNT, 40, 1e-3)
    )
    others = np.sqrt(np.mean((gradients - truth) ** 2))
    rms = np.sqrt(np.mean(off**2))
    assert rms < 0.03
    assert rms < 0.5 * others, "no better than where gradients meet"


def test_corners_of_a_board_square_to_the_sensor_are_not_all_drawn_one_way() -> None:
    image, truth = drawn(120, 4, square_on=True)
    off = found(image, truth)
    phase = truth % 1.0
    for axis in range(2):
        low, high = off[phase[:, axis] < 0.5, axis], off[phase[:, axis] >= 0.5, axis]
        assert abs(low.mean() - high.mean()) < 0.005


def test_where_there_is_no_corner_none_is_said() -> None:
    plain = np.random.default_rng(0).normal(120, 3, (100, 100)).astype(np.uint8)
    assert np.isnan(fit_saddles(plain, np.array([[50.0, 50.0]]), 8.0, 4.0)).all()
    assert fit_saddles(plain, np.empty((0, 2)), 8.0, 4.0).shape == (0, 2)


def test_a_corner_by_the_rim_of_the_image_is_fitted_to_what_is_there() -> None:
    image, truth = drawn(1, 5)
    left = image[:, 26:]
    off = fit_saddles(left, truth - (26, 0), 10.0, 6.0) - (truth - (26, 0))
    assert np.isnan(off).all() or np.abs(off).max() < 0.05
