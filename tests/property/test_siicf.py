"""Symmetry, sizes, strides and instruction sets of the native detector."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from facetcam import _core
from facetcam.features import SIICF, Keypoints


def photo_like(height: int, width: int, seed: int) -> np.ndarray:
    """Rectangles at random with blur and noise: no two responses are equal."""
    rng = np.random.default_rng(seed)
    image = np.full((height, width), 90, np.uint8)
    boxes = rng.integers([0, 0, 5, 5, 10], [width, height, 40, 40, 245], (80, 5))
    for x, y, w, h, grey in boxes.tolist():
        cv2.rectangle(image, (x, y), (x + w, y + h), grey, -1)
    noisy = cv2.GaussianBlur(image, (0, 0), 0.8) + rng.normal(0, 2, image.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


TURNS: dict[str, tuple[Callable[[np.ndarray], np.ndarray], Callable[[np.ndarray, int, int], np.ndarray]]] = {
    "left-right": (lambda im: im[:, ::-1], lambda xy, h, w: np.column_stack([w - 1 - xy[:, 0], xy[:, 1]])),
    "upside down": (lambda im: im[::-1], lambda xy, h, w: np.column_stack([xy[:, 0], h - 1 - xy[:, 1]])),
    "quarter turn": (lambda im: np.rot90(im), lambda xy, h, w: np.column_stack([xy[:, 1], w - 1 - xy[:, 0]])),
    "half turn": (lambda im: np.rot90(im, 2), lambda xy, h, w: np.array([w - 1, h - 1]) - xy),
}


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("mode", ["robust", "paper"])
@pytest.mark.parametrize("size", [(160, 240), (155, 241), (150, 222)])
def test_points_turn_with_the_image(turn: str, mode: str, size: tuple[int, int]) -> None:
    image = photo_like(*size, seed=2)
    detector = SIICF.create(mode=mode, max_features=None)
    turn_image, turn_points = TURNS[turn]
    expected = turn_points(detector.detect(image).xy.astype(float), *size)
    found = detector.detect(turn_image(image))
    distance = np.linalg.norm(found.xy[:, None] - expected, axis=2)
    assert len(expected) > 50
    assert len(found) == len(expected)
    assert distance.min(axis=1).max() < 0.05
    assert distance.min(axis=0).max() < 0.05


def native(image: np.ndarray, isa: int, compression: float = 0.05) -> np.ndarray:
    return _core.detect_corners(
        image,
        None,
        _core.transfer_table(image, None, 64.0),
        scales=4,
        sigma=1.2,
        window=1.5,
        alpha=0.01,
        compression=compression,
        coarse_weight=0.7,
        threshold=0.0,
        suppression=2,
        border=4,
        max_features=0,
        cell=0,
        oriented=True,
        threads=1,
        isa=isa,
    )


@pytest.mark.parametrize("isa", range(1, _core.best_isa() + 1))
@pytest.mark.parametrize("width", [97, 160, 203])
def test_instruction_sets_agree_bit_for_bit(isa: int, width: int) -> None:
    image = photo_like(131, width, seed=3)
    for compression in (0.0, 0.05):
        np.testing.assert_array_equal(native(image, isa, compression), native(image, 0, compression))


def assert_sound(found: Keypoints, shape: tuple[int, ...]) -> None:
    assert found.xy.dtype == np.float32
    for name in ("xy", "size", "angle", "response"):
        assert np.isfinite(getattr(found, name)).all()
    assert ((found.xy >= 0) & (found.xy <= [shape[1] - 1, shape[0] - 1])).all()
    assert ((found.angle >= 0) & (found.angle < 360)).all()


@settings(max_examples=60, deadline=None)
@given(
    image=st.one_of(
        hnp.arrays(dtype, hnp.array_shapes(min_dims=2, max_dims=2, min_side=1, max_side=70))
        for dtype in (np.uint8, np.uint16)
    ),
    steps=st.tuples(st.sampled_from([-2, -1, 1, 2]), st.sampled_from([-3, -1, 1, 3])),
    threads=st.integers(1, 4),
    scales=st.integers(1, 6),
    spread=st.sampled_from([0, 7]),
)
def test_any_size_and_stride(
    image: np.ndarray, steps: tuple[int, int], threads: int, scales: int, spread: int
) -> None:
    view = image[:: steps[0], :: steps[1]]
    detector = SIICF.create(threads=threads, scales=scales, spread=spread, threshold=0.0, border=0)
    found = detector.detect(view)
    assert_sound(found, view.shape)
    np.testing.assert_array_equal(found.xy, detector.detect(np.ascontiguousarray(view)).xy)


@settings(max_examples=25, deadline=None)
@given(
    image=hnp.arrays(
        np.float32,
        hnp.array_shapes(min_dims=2, max_dims=2, min_side=24, max_side=50),
        elements=st.floats(-(2.0**100), 2.0**100, width=32),
    )
)
def test_any_float_values(image: np.ndarray) -> None:
    assert_sound(SIICF.create(threshold=0.0).detect(image), image.shape)
