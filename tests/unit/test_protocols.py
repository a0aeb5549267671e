"""Protocols A to D against slow transcriptions of their definitions, point by point, on random keypoints."""

from __future__ import annotations

import itertools
import math

import cv2
import numpy as np
import pytest

from facetcam.evaluation.matching import matching_accuracy, mutual_nearest
from facetcam.evaluation.overlap import overlap_repeatability
from facetcam.evaluation.repeatability import one_to_one, superpoint
from facetcam.features import Keypoints

SIZES = ((320, 240), (300, 260))
HS = {
    "zoom and turn": [[0.9, -0.25, 30.0], [0.25, 0.9, -20.0], [0.0, 0.0, 1.0]],
    "viewpoint": [[1.05, 0.08, -12.0], [-0.04, 0.93, 14.0], [4e-4, -3e-4, 1.0]],
}


def mapped(H: np.ndarray, x: float, y: float) -> tuple[float, float]:
    u, v, w = (float(H[i, 0]) * x + float(H[i, 1]) * y + float(H[i, 2]) for i in range(3))
    return u / w, v / w


def within(place: tuple[float, float], size: tuple[int, int], border: float = 0.0) -> bool:
    return all(border <= c <= n - 1 - border for c, n in zip(place, size, strict=True))


def scattered(H: np.ndarray, seed: int) -> tuple[Keypoints, Keypoints]:
    """Points of the first image, and in the second some of them, moved, among others."""
    rng = np.random.default_rng(seed)
    a = rng.uniform(0, np.array(SIZES[0]) - 1, (160, 2))
    again = [mapped(H, x, y) for x, y in a[rng.permutation(160)[:100]].tolist()]
    b = np.concatenate([np.array(again) + rng.normal(0, 1.5, (100, 2)), rng.uniform(0, 250, (60, 2))])
    b = b[(b >= 0).all(axis=1) & (b <= np.array(SIZES[1]) - 1).all(axis=1)]
    b = b[rng.permutation(len(b))]
    first, second = (Keypoints.at(xy.astype(np.float32)) for xy in (a, b))
    first.size[:] = rng.uniform(8, 30, len(first))
    second.size[:] = rng.uniform(8, 30, len(second))
    return first, second


def shared(points: Keypoints, H: np.ndarray, sizes: tuple, border: float) -> list[tuple[float, float]]:
    places = [(float(x), float(y)) for x, y in points.xy]
    return [p for p in places if within(p, sizes[0], border) and within(mapped(H, *p), sizes[1], border)]


@pytest.fixture(params=itertools.product(HS, (0, 1)), ids=str)
def case(request: pytest.FixtureRequest) -> tuple[np.ndarray, Keypoints, Keypoints]:
    H = np.array(HS[request.param[0]])
    return H, *scattered(H, request.param[1])


def test_protocol_a(case: tuple[np.ndarray, Keypoints, Keypoints]) -> None:
    H, first, second = case
    back = np.linalg.inv(H)
    a = shared(first, H, SIZES, 0.0)[:70]
    b = shared(second, back, SIZES[::-1], 0.0)[:70]
    near = []
    for points, others, to in ((a, b, H), (b, a, back)):
        nearest = [min(math.dist(mapped(to, *p), q) for q in others) for p in points]
        near += [distance for distance in nearest if distance <= 3]
    found = superpoint(first, second, H, SIZES, top=70)
    assert 0.1 < found.score < 0.95
    assert found.score == pytest.approx(len(near) / (len(a) + len(b)))
    assert found.error == pytest.approx(sum(near) / len(near))


def greedy(costs: list[tuple[float, int, int]]) -> list[float]:
    """Costs of the pairs chosen one after the other, the cheapest first, each side used once."""
    chosen, left, right = [], set(), set()
    for cost, i, j in sorted(costs):
        if i not in left and j not in right:
            chosen.append(cost)
            left.add(i)
            right.add(j)
    return chosen


def test_protocol_b(case: tuple[np.ndarray, Keypoints, Keypoints]) -> None:
    H, first, second = case
    a = [mapped(H, *p) for p in shared(first, H, SIZES, 15.0)[:50]]
    b = shared(second, np.linalg.inv(H), SIZES[::-1], 15.0)[:50]
    pairs = [(math.dist(p, q), i, j) for i, p in enumerate(a) for j, q in enumerate(b)]
    chosen = greedy([pair for pair in pairs if pair[0] <= 3])
    found = one_to_one(first, second, H, SIZES, top=50)
    assert 0.1 < found.score < 0.95
    assert found.score == pytest.approx(len(chosen) / min(len(a), len(b)))
    assert found.error == pytest.approx(sum(chosen) / len(chosen))


def polygon(H: np.ndarray, x: float, y: float, radius: float, centre: tuple[float, float], scale: float):
    """A circle of the first image in the second: the outline mapped, and scaled about the centre's image."""
    turns = np.linspace(0, 2 * np.pi, 90, endpoint=False)
    step = 1e-3  # the map is taken to be linear round the centre, as ellipses are
    outline = [
        np.array(mapped(H, x + step * np.cos(t), y + step * np.sin(t))) - centre for t in turns.tolist()
    ]
    return (np.array(outline) * (radius / step * scale) + centre).astype(np.float32)


def overlap_error(H: np.ndarray, p: tuple[float, float, float], q: tuple[float, float, float]) -> float:
    """One minus intersection over union of polygons, both scaled so that the second has radius 30."""
    centre, scale = mapped(H, *p[:2]), 30 / q[2]
    ellipse = polygon(H, p[0], p[1], p[2], centre, scale)
    circle = polygon(np.eye(3), q[0], q[1], q[2], q[:2], scale)
    both, _ = cv2.intersectConvexConvex(ellipse, circle)
    return 1 - both / (cv2.contourArea(ellipse) + cv2.contourArea(circle) - both)


def test_protocol_c(case: tuple[np.ndarray, Keypoints, Keypoints]) -> None:
    H, first, second = case
    sides = []
    for points, to, sizes in ((first, H, SIZES), (second, np.linalg.inv(H), SIZES[::-1])):
        circles = [
            (float(x), float(y), float(s) / 2) for (x, y), s in zip(points.xy, points.size, strict=True)
        ]
        sides.append(
            [
                (x, y, r)
                for x, y, r in circles
                if all(
                    within(c, sizes[0]) and within(mapped(to, *c), sizes[1])
                    for c in itertools.product((x - r, x + r), (y - r, y + r))
                )
            ][:60]
        )
    costs = []
    for (i, p), (j, q) in itertools.product(enumerate(sides[0]), enumerate(sides[1])):
        if math.dist(mapped(H, *p[:2]), q[:2]) < 30:
            costs.append((overlap_error(H, p, q), i, j))
    expected = len(greedy([cost for cost in costs if cost[0] < 0.4])) / min(map(len, sides))
    found = overlap_repeatability(first, second, H, SIZES, top=60)
    assert found.score > 0.05
    assert found.score == pytest.approx(expected, abs=1.01 / min(map(len, sides)))  # a pair at the limit


def test_protocol_d(case: tuple[np.ndarray, Keypoints, Keypoints]) -> None:
    H, first, second = case
    rng = np.random.default_rng(5)
    left = rng.integers(0, 256, (len(first), 8), np.uint8)
    right = rng.integers(0, 256, (len(second), 8), np.uint8)
    hamming = [[sum(int(x ^ y).bit_count() for x, y in zip(p, q, strict=True)) for q in right] for p in left]
    matches = mutual_nearest(left, right, cv2.NORM_HAMMING)
    for i, j in matches.tolist():
        assert hamming[i][j] == min(hamming[i]) == min(row[j] for row in hamming)
    rows_with_one_best = [
        i
        for i, row in enumerate(hamming)
        if row.count(min(row)) == 1
        and [other[row.index(min(row))] for other in hamming].count(min(row)) == 1
        and min(other[row.index(min(row))] for other in hamming) == min(row)
    ]
    assert set(rows_with_one_best) <= set(matches[:, 0].tolist())
    # Points matched as the homography says, some of them wrongly.
    a = first.xy[:90].astype(float)
    b = np.array([mapped(H, x, y) for x, y in a.tolist()]) + rng.normal(0, 2, (90, 2))
    result = matching_accuracy(a, b, H, SIZES[0])
    for t in (1, 3, 5):
        right_ones = sum(
            math.dist(mapped(H, *p), q) <= t for p, q in zip(a.tolist(), b.tolist(), strict=True)
        )
        assert result.accuracy[t] == pytest.approx(right_ones / 90)
    cv2.setRNGSeed(0)
    estimate, _ = cv2.findHomography(a, b, cv2.RANSAC, 3.0)
    corners = itertools.product((0, SIZES[0][0] - 1), (0, SIZES[0][1] - 1))
    off = [math.dist(mapped(estimate, *c), mapped(H, *c)) for c in corners]
    assert result.corner_error == pytest.approx(sum(off) / 4)
