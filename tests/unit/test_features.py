"""SIICF's interface: order, masks, spread, input types; descriptors and matching."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial import cKDTree

from facetcam.errors import ConfigError, FacetcamError
from facetcam.features import SIICF, Keypoints, describe, match_mutual, match_windowed
from facetcam.features.matching import hamming, match_groups, mutual_best


@pytest.fixture(scope="module")
def scene() -> np.ndarray:
    """Dark and bright rectangles at random, slightly blurred, with noise."""
    rng = np.random.default_rng(7)
    image = np.full((240, 320), 90, np.uint8)
    for x, y, w, h, grey in rng.integers([0, 0, 8, 8, 20], [310, 230, 60, 60, 230], (80, 5)).tolist():
        cv2.rectangle(image, (x, y), (x + w, y + h), grey, -1)
    noisy = cv2.GaussianBlur(image, (0, 0), 0.7) + rng.normal(0, 1.5, image.shape)
    return np.clip(noisy, 0, 255).astype(np.uint8)


def test_order_is_total_and_repeatable(scene: np.ndarray) -> None:
    first, second = SIICF.create().detect(scene), SIICF.create().detect(scene)
    assert len(first) > 100
    np.testing.assert_array_equal(first.xy, second.xy)
    order = np.lexsort((first.xy[:, 0], first.xy[:, 1], -first.response))
    np.testing.assert_array_equal(order, np.arange(len(first)))


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_threads_change_nothing(scene: np.ndarray, threads: int) -> None:
    expected = SIICF.create(threads=3).detect(scene)
    found = SIICF.create(threads=threads).detect(scene)
    np.testing.assert_array_equal(found.xy, expected.xy)
    np.testing.assert_array_equal(found.angle, expected.angle)


def test_corners_follow_a_shift_of_a_fraction_of_a_pixel() -> None:
    rng = np.random.default_rng(5)
    fine = np.full((960, 1280), 100, np.uint8)
    for x, y, w, h, grey in rng.integers([0, 0, 80, 80, 20], [1200, 900, 300, 300, 230], (60, 5)).tolist():
        cv2.rectangle(fine, (x, y), (x + w, y + h), grey, -1)
    first, second = (
        cv2.resize(fine[:-8, left : left + 1264], (158, 119), interpolation=cv2.INTER_AREA) for left in (8, 5)
    )
    a, b = SIICF.create(border=8).detect(first).xy, SIICF.create(border=8).detect(second).xy
    moved = a + np.array([3 / 8, 0])
    nearest = b[np.linalg.norm(moved[:, None] - b, axis=2).argmin(axis=1)]
    error = np.linalg.norm(moved - nearest, axis=1)
    assert len(a) > 50
    assert np.median(error) < 0.08
    assert (error < 0.5).mean() > 0.9


def test_mask_and_limit_are_kept(scene: np.ndarray) -> None:
    mask = np.zeros(scene.shape, bool)
    mask[40:200, 60:150] = True
    found = SIICF.create(max_features=20).detect(scene, mask)
    assert len(found) == 20
    x, y = np.rint(found.xy).astype(int).T
    assert mask[y, x].all()


def test_spread_fills_more_cells(scene: np.ndarray) -> None:
    def cells(spread: int) -> int:
        found = SIICF.create(max_features=60, spread=spread).detect(scene)
        assert len(found) == 60
        return len({tuple(c) for c in (found.xy // 40).astype(int).tolist()})

    assert cells(40) > 1.3 * cells(0)


@pytest.mark.parametrize("dtype", [np.uint16, np.float32, np.float64])
def test_types_agree(scene: np.ndarray, dtype: type) -> None:
    scale = 257 if dtype == np.uint16 else 1 / 255
    found = SIICF.create(max_features=100).detect((scene * dtype(scale)).astype(dtype))
    expected = SIICF.create(max_features=100).detect(scene)
    near = np.linalg.norm(found.xy[:, None] - expected.xy, axis=2).min(axis=1)
    assert (near < 0.05).mean() > 0.95


def test_colour_strides_and_slices(scene: np.ndarray) -> None:
    expected = SIICF.create().detect(scene)
    colour = np.repeat(scene[:, :, None], 3, axis=2)
    assert np.abs(SIICF.create().detect(colour).xy - expected.xy).max() == 0
    strided = colour[:, :, 1]
    assert not strided.flags.c_contiguous
    np.testing.assert_array_equal(SIICF.create().detect(strided).xy, expected.xy)


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (np.zeros((20, 20), np.int32), "expected an array of uint8"),
        ([[1, 2]], "got list"),
        (np.zeros((20,), np.uint8), "expected shape"),
        (np.zeros((20, 20, 2), np.uint8), "expected shape"),
        (np.zeros((0, 20), np.uint8), "at least one pixel"),
        (np.full((40, 40), np.nan, np.float32), "NaN"),
    ],
)
def test_wrong_images_say_what_is_wrong(image: np.ndarray, message: str) -> None:
    with pytest.raises(FacetcamError, match=message):
        SIICF.create().detect(image)


@pytest.mark.parametrize("shape", [(1, 1), (3, 200), (200, 3), (24, 24)])
@pytest.mark.parametrize("value", [0, 255])
def test_tiny_black_and_saturated_images_have_no_corners(shape: tuple[int, int], value: int) -> None:
    for descriptor, columns in (("gradients", 128), ("binary", 32)):
        detector = SIICF.create(descriptor=descriptor)
        keypoints, descriptors = detector.detectAndCompute(np.full(shape, value, np.uint8))
        assert keypoints.xy.shape == (0, 2)
        assert descriptors.shape == (0, columns)


def test_wrong_mask_and_parameters(scene: np.ndarray) -> None:
    with pytest.raises(FacetcamError, match="mask: expected the shape"):
        SIICF.create().detect(scene, np.ones((10, 10), np.uint8))
    with pytest.raises(ConfigError, match="did you mean 'max_features'"):
        SIICF.create(max_feature=10)
    with pytest.raises(ConfigError, match="max_features must be at least 1"):
        SIICF.create(max_features=0)


def test_keypoints_go_to_opencv_and_back(scene: np.ndarray) -> None:
    found = SIICF.create(max_features=20).detect(scene)
    again = Keypoints.from_cv2(found.to_cv2())
    for name in ("xy", "size", "angle", "response", "level"):
        np.testing.assert_allclose(getattr(again, name), getattr(found, name), rtol=1e-6)


@pytest.mark.parametrize(("scale", "median", "share"), [(1.0, 3.0, 0.85), (0.7, 7.0, 0.65)])
@pytest.mark.parametrize("degrees", [10.0, 37.0, 90.0, 215.0])
def test_directions_turn_with_the_image(
    scene: np.ndarray, degrees: float, scale: float, median: float, share: float
) -> None:
    A = cv2.getRotationMatrix2D((159.5, 119.5), -degrees, scale)  # clockwise as shown, like angles
    turned = SIICF.create().detect(cv2.warpAffine(scene, A, (320, 240), borderMode=cv2.BORDER_REFLECT))
    found = SIICF.create().detect(scene)
    distance, nearest = cKDTree(found.xy @ A[:, :2].T + A[:, 2]).query(turned.xy)
    same = distance < 1.0
    error = turned.angle[same] - found.angle[nearest[same]] - degrees
    error = np.abs((error + 180) % 360 - 180)
    assert same.sum() > 80
    assert np.median(error) < median
    assert np.mean(error < 12.0) > share


@pytest.mark.parametrize("descriptor", ["gradients", "binary"])
def test_descriptors_of_a_mirrored_view_match_the_direct_view(scene: np.ndarray, descriptor: str) -> None:
    found = SIICF.create(max_features=200).detect(scene)
    found, direct = describe(scene, found, descriptor=descriptor)
    xy = np.column_stack([scene.shape[1] - 1 - found.xy[:, 0], found.xy[:, 1]])
    seen = Keypoints(xy, found.size, np.mod(180 - found.angle, 360), found.response, found.level)
    flipped = np.ascontiguousarray(scene[:, ::-1])
    kept, mirrored = describe(flipped, seen, flipped=True, descriptor=descriptor)
    assert len(kept) > 100
    matches = match_mutual(direct, mirrored)
    expected = np.linalg.norm(xy[matches[:, 0]] - kept.xy[matches[:, 1]], axis=1)
    assert (expected < 0.5).mean() > 0.95


def test_gradients_bear_a_wrong_size_better_than_one_patch_does(scene: np.ndarray) -> None:
    found = SIICF.create(max_features=150).detect(scene)
    _, right = describe(scene, found)
    assert (right.shape, right.dtype) == ((len(found), 128), np.float32)
    np.testing.assert_allclose(np.linalg.norm(right, axis=1), 1.0, rtol=1e-5)
    wrong_size = replace(found, size=found.size * np.float32(1.6))
    _, wrong = describe(scene, wrong_size)
    ours = match_mutual(right, wrong)
    sift = cv2.SIFT.create()
    one_patch = [sift.compute(scene, points.to_cv2())[1] for points in (found, wrong_size)]
    theirs = match_mutual(*one_patch)
    shares = [np.sum(matches[:, 0] == matches[:, 1]) / len(found) for matches in (ours, theirs)]
    assert shares[0] > 0.9
    assert shares[0] > shares[1]


def test_descriptors_say_how_they_compare(scene: np.ndarray) -> None:
    for descriptor, norm in (("gradients", cv2.NORM_L2), ("binary", cv2.NORM_HAMMING)):
        detector = SIICF.create(max_features=30, descriptor=descriptor)
        _, descriptors = detector.detectAndCompute(scene)
        assert detector.defaultNorm() == norm
        assert detector.descriptorSize() == descriptors.shape[1]
        matches = cv2.BFMatcher(detector.defaultNorm(), crossCheck=True).match(descriptors, descriptors)
        assert all(match.queryIdx == match.trainIdx for match in matches)
    flat, none = np.full((60, 80), 50, np.uint8), Keypoints.at(np.array([[40, 30]], np.float32))
    assert not describe(flat, none)[1].any()
    assert describe(flat, none[:0])[1].shape == (0, 128)
    with pytest.raises(ConfigError, match="did you mean 'binary'"):
        SIICF.create(descriptor="binray")


@pytest.mark.parametrize("width", [32, 61])
def test_distances_and_their_mutual_best_are_those_of_brute_force(width: int) -> None:
    rng = np.random.default_rng(4)
    a, b = (rng.integers(0, 256, (n, width), np.uint8) for n in (40, 55))
    b[:20] = a[:20] ^ rng.choice([0, 1, 16], (20, width)).astype(np.uint8)
    distances = hamming(a, b)
    np.testing.assert_array_equal(distances, brute_distances(a, b))
    for ratio, limit in ((1.0, 8 * width), (0.8, 8 * width), (1.0, 20)):
        rows, columns = mutual_best(distances, ratio, limit)
        np.testing.assert_array_equal(np.column_stack([rows, columns]), match_mutual(a, b, ratio, limit))
    assert hamming(a, b[:0]).shape == (40, 0)
    assert len(mutual_best(hamming(a, b[:0]), 1.0, 9)[0]) == 0
    with pytest.raises(FacetcamError, match="train descriptors: expected uint8"):
        hamming(a, b[:, :8])


def test_things_with_several_descriptors_match_by_the_nearest_of_them() -> None:
    rng = np.random.default_rng(5)
    a, b = (rng.integers(0, 256, (n, 32), np.uint8) for n in (40, 120))
    b[:60] = np.tile(a[:20], (3, 1)) ^ rng.choice([0, 1, 16], (60, 32)).astype(np.uint8)
    group = np.concatenate([np.tile(np.arange(20), 3), rng.permutation(np.arange(60) % 25) + 20])
    near = np.stack([brute_distances(a, b[group == g]).min(axis=1) for g in range(45)], axis=1)
    for ratio, limit in ((1.0, 256), (0.8, 256), (1.0, 20)):
        expected = np.column_stack(mutual_best(near, ratio, limit))
        np.testing.assert_array_equal(match_groups(a, b, group, ratio, limit), expected)
        assert len(expected) > 10
    assert match_groups(a, b[:0], group[:0], 0.8, 20).shape == (0, 2)
    for wrong in (group[1:], group - 1):
        with pytest.raises(FacetcamError, match="group: expected 120 numbers from 0"):
            match_groups(a, b, wrong, 0.8, 20)


def test_mutual_matches_of_floats_are_those_of_brute_force() -> None:
    rng = np.random.default_rng(3)
    a, b = (rng.normal(size=(n, 16)).astype(np.float32) for n in (60, 45))
    b[:30] = a[:30] + 0.3 * rng.normal(size=(30, 16))
    distance = np.linalg.norm(a[:, None].astype(float) - b, axis=2)
    first = distance.argmin(axis=1)
    mutual = distance.argmin(axis=0)[first] == np.arange(len(a))
    best, second = np.sort(distance, axis=1)[:, :2].T
    for ratio, limit in ((1.0, None), (0.6, None), (1.0, 1.2)):
        kept = mutual & (best <= ratio * second) & (best <= (limit or np.inf))
        expected = np.column_stack([np.flatnonzero(kept), first[kept]])
        np.testing.assert_array_equal(match_mutual(a, b, ratio, limit), expected)
    assert match_mutual(a, b[:0]).shape == (0, 2)
    assert match_mutual(a[:5], a[:1]).tolist() == [[0, 0]]
    for wrong in (b[:, :8], np.full_like(b, np.nan), b.astype(np.uint8)):
        with pytest.raises(FacetcamError, match="train descriptors: expected"):
            match_mutual(a, wrong)


def brute_distances(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.unpackbits(a[:, None] ^ b[None], axis=2).sum(axis=2)


@pytest.mark.parametrize("width", [32, 61])
def test_mutual_matches_are_those_of_brute_force(width: int) -> None:
    rng = np.random.default_rng(3)
    a, b = (rng.integers(0, 256, (n, width), dtype=np.uint8) for n in (40, 60))
    distance = brute_distances(a, b)
    ab, ba = distance.argmin(axis=1), distance.argmin(axis=0)
    expected = [(i, j) for i, j in enumerate(ab) if ba[j] == i]
    np.testing.assert_array_equal(match_mutual(a, b), expected)
    second = np.partition(distance, 1, axis=1)[:, 1]
    strict = [(i, j) for i, j in expected if distance[i, j] <= 0.9 * second[i]]
    np.testing.assert_array_equal(match_mutual(a, b, ratio=0.9).reshape(-1, 2), np.reshape(strict, (-1, 2)))


def test_windowed_matches_are_those_of_brute_force() -> None:
    rng = np.random.default_rng(4)
    n, m, radius, limit = 150, 200, 30.0, 120
    a, b = (rng.integers(0, 256, (k, 32), dtype=np.uint8) for k in (n, m))
    a_xy, b_xy = (rng.uniform(0, 300, (k, 2)).astype(np.float32) for k in (n, m))
    a_view, b_view = rng.integers(0, 3, n), rng.integers(0, 3, m)
    distance = brute_distances(a, b).astype(float)
    apart = np.linalg.norm(a_xy[:, None] - b_xy, axis=2) > radius
    distance[apart | (a_view[:, None] != b_view)] = np.inf
    best = distance.argmin(axis=1)
    expected = np.full(n, -1)
    for train in range(m):
        wanting = [q for q in range(n) if best[q] == train and distance[q, train] <= limit]
        if wanting:
            expected[min(wanting, key=lambda q: distance[q, train])] = train
    found = match_windowed(a, a_xy, a_view, b, b_xy, b_view, radius, limit)
    assert (found >= 0).sum() > 20
    np.testing.assert_array_equal(found, expected)


def test_matching_nothing_gives_nothing() -> None:
    none, one = np.zeros((0, 32), np.uint8), np.zeros((1, 32), np.uint8)
    assert match_mutual(none, one).shape == (0, 2)
    assert match_mutual(one, none).shape == (0, 2)
    found = match_windowed(one, [[0, 0]], [0], none, np.zeros((0, 2)), np.zeros(0), 5.0)
    np.testing.assert_array_equal(found, [-1])
    floats = np.zeros((1, 32), np.float32)
    with pytest.raises(FacetcamError, match="query descriptors: expected uint8"):
        match_mutual(one.astype(np.int32), one)
    with pytest.raises(FacetcamError, match="train descriptors: expected floats"):
        match_mutual(floats, one)
    with pytest.raises(FacetcamError, match="expected uint8"):
        match_windowed(floats, [[0, 0]], [0], floats, [[0, 0]], [0], 5.0)
    with pytest.raises(FacetcamError, match="radius"):
        match_windowed(one, [[0, 0]], [0], one, [[0, 0]], [0], float("nan"))


def wall_beside_the_dark() -> tuple[np.ndarray, np.ndarray]:
    """Faint patches on a bright wall, which the mask shows, and beside it two hundredths of grey value 10."""
    rng = np.random.default_rng(5)
    faint = cv2.resize(rng.uniform(120.0, 180.0, (20, 25)), (250, 200), interpolation=cv2.INTER_NEAREST)
    image = np.rint(cv2.GaussianBlur(faint, (0, 0), 1.2)).astype(np.uint8)
    image[:4] = 10
    mask = np.ones(image.shape, np.bool_)
    mask[:24] = False
    return image, mask


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_black_is_the_darkest_hundredth_where_it_is_not_given(dtype: type) -> None:
    unit = 257 if dtype is np.uint16 else 1
    image = wall_beside_the_dark()[0].astype(dtype) * dtype(unit)
    unknown, given = (
        SIICF.create(threshold=0.003, black=black).detect(image) for black in (None, 10.0 * unit)
    )
    assert len(given) > 100
    np.testing.assert_allclose(unknown.xy, given.xy, atol=1e-3)


def test_a_wall_that_is_all_the_mask_shows_has_more_contrast_than_beside_the_dark() -> None:
    image, mask = wall_beside_the_dark()
    alone, beside = (SIICF.create(black=black).detect(image, mask) for black in (None, 10.0))
    assert len(alone) > 100 and len(beside) < 10


def test_keypoints_are_joined_in_their_order(scene: np.ndarray) -> None:
    found = SIICF.create().detect(scene)
    again = Keypoints.joined([found[:7], found[7:7], found[7:]])
    for name in ("xy", "size", "angle", "response", "level"):
        np.testing.assert_array_equal(getattr(again, name), getattr(found, name))
        assert getattr(again, name).dtype == getattr(found, name).dtype
    assert len(Keypoints.joined([])) == 0
