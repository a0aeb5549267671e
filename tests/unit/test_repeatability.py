"""Protocols A to D on points whose scores are known beforehand."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from facetcam.errors import ConfigError, SourceError
from facetcam.evaluation.datasets import Sequence, find_sequences
from facetcam.evaluation.detectors import evaluate_sequence
from facetcam.evaluation.matching import matching_accuracy, mutual_nearest
from facetcam.evaluation.overlap import overlap_repeatability
from facetcam.evaluation.peers import peers
from facetcam.evaluation.repeatability import one_to_one, superpoint, warp
from facetcam.evaluation.synthetic import changes
from facetcam.features import Keypoints

SIZE = (400, 300)
SIZES = (SIZE, SIZE)


def grid_points(step: float = 20.0) -> np.ndarray:
    v, u = np.mgrid[40:261:step, 40:361:step]
    return np.column_stack([u.ravel(), v.ravel()]).astype(np.float32)


def test_warp_is_that_of_opencv() -> None:
    H = np.array([[0.9, 0.1, 5.0], [-0.05, 1.1, -3.0], [1e-4, -2e-4, 1.0]])
    points = grid_points()
    np.testing.assert_allclose(warp(H, points), cv2.perspectiveTransform(points[:, None], H)[:, 0], rtol=1e-5)
    assert warp(H, points[:0]).shape == (0, 2)


def test_one_to_one_counts_each_point_once() -> None:
    points = grid_points()
    doubled = np.concatenate([points, points + np.array([1.0, 0.0])]).astype(np.float32)
    once = one_to_one(Keypoints.at(points), Keypoints.at(points + np.float32(2)), np.eye(3), SIZES)
    assert (once.score, once.count) == (1.0, len(points))
    assert once.error == pytest.approx(np.sqrt(8), rel=1e-5)
    # Twice as many points near the same places pair up no more than once.
    twice = one_to_one(Keypoints.at(doubled), Keypoints.at(points), np.eye(3), SIZES)
    assert (twice.score, twice.count) == (1.0, len(points))
    # Half of the points lie 3.5 px off, half 1 px.
    moved = points.copy()
    moved[::2, 0] += 3.5
    moved[1::2, 0] += 1.0
    half = one_to_one(Keypoints.at(points), Keypoints.at(moved), np.eye(3), SIZES)
    assert half.score == pytest.approx(len(points[1::2]) / len(points))
    assert half.error == pytest.approx(1.0)


def test_top_and_common_region() -> None:
    points = grid_points()
    H = np.array([[1.0, 0, 200.0], [0, 1, 0], [0, 0, 1]])
    shared = (points[:, 0] + 200 <= SIZE[0] - 1 - 15).sum()
    result = one_to_one(Keypoints.at(points), Keypoints.at(points + np.float32([200, 0])), H, SIZES)
    assert (result.score, result.count) == (1.0, shared)
    assert one_to_one(Keypoints.at(points), Keypoints.at(points), np.eye(3), SIZES, top=7).count == 7
    nothing = one_to_one(Keypoints.at(points), Keypoints.at(points[:0]), np.eye(3), SIZES)
    assert (nothing.score, nothing.count) == (0.0, 0)


def test_superpoint_counts_both_ways() -> None:
    points = grid_points()
    extra = np.concatenate([points, points[:10] + 9.0]).astype(np.float32)
    result = superpoint(Keypoints.at(points), Keypoints.at(extra), np.eye(3), SIZES)
    assert result.score == pytest.approx(2 * len(points) / (2 * len(points) + 10))
    assert result.error == 0.0


@pytest.mark.parametrize(("ratio", "found"), [(1.0, True), (1.25, True), (1.35, False)])
def test_overlap_of_circles_is_the_ratio_of_their_areas(ratio: float, found: bool) -> None:
    points = grid_points()
    result = overlap_repeatability(
        Keypoints.at(points, size=20.0 * ratio), Keypoints.at(points, size=20.0), np.eye(3), SIZES
    )
    assert result.score == (1.0 if found else 0.0)
    if found:
        assert result.error == pytest.approx(1 - ratio**-2, abs=0.03)


def test_overlap_follows_the_scale_of_the_homography() -> None:
    points = grid_points()
    H = np.diag([0.5, 0.5, 1.0])
    right = overlap_repeatability(Keypoints.at(points, 20.0), Keypoints.at(points / 2, 10.0), H, SIZES)
    wrong = overlap_repeatability(Keypoints.at(points, 20.0), Keypoints.at(points / 2, 20.0), H, SIZES)
    assert (right.score, wrong.score) == (1.0, 0.0)


def test_matching_accuracy_and_homography() -> None:
    rng = np.random.default_rng(0)
    H = np.array([[0.95, 0.1, 5.0], [-0.08, 1.02, 9.0], [1e-4, 5e-5, 1.0]])
    first = grid_points().astype(float)
    second = warp(H, first)
    second[:40] += [0.0, 50.0]
    second[40:60] += [2.0, 0.0]
    order = rng.permutation(len(first))
    result = matching_accuracy(first[order], second[order], H, SIZE)
    n = len(first)
    assert result.accuracy == pytest.approx({1.0: (n - 60) / n, 3.0: (n - 40) / n, 5.0: (n - 40) / n})
    assert result.corner_error < 1.5  # the 20 points 2 px off count as right for RANSAC
    assert matching_accuracy(first[:0], first[:0], H, SIZE).accuracy[3.0] == 0.0
    assert (
        len(mutual_nearest(np.zeros((0, 32), np.uint8), np.zeros((5, 32), np.uint8), cv2.NORM_HAMMING)) == 0
    )


def textured() -> np.ndarray:
    rng = np.random.default_rng(1)
    return cv2.resize(rng.integers(0, 256, (60, 80), np.uint8), (320, 240), interpolation=cv2.INTER_CUBIC)


def test_changes_move_points_as_their_homography_says() -> None:
    image = textured()
    for name, change in changes().items():
        changed, H = change(image)
        assert changed.shape == image.shape and changed.dtype == np.uint8, name
        patch = cv2.warpPerspective(
            changed, H, image.shape[::-1], flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        )
        seen = cv2.warpPerspective(np.ones_like(image), H, image.shape[::-1])
        back = (
            cv2.warpPerspective(seen, H, image.shape[::-1], flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP)
            > 0
        )
        assert np.corrcoef(patch[back], image[back])[0, 1] > 0.5, name


@pytest.mark.parametrize("pattern", ["H1to2p", "H_1_2"])
def test_folders_are_found(tmp_path: Path, pattern: str) -> None:
    folder = tmp_path / "wall"
    folder.mkdir()
    H = np.array([[1.0, 0, 3], [0, 1, 2], [0, 0, 1]])
    for index in (1, 2):
        cv2.imwrite(str(folder / f"img{index}.png"), textured())
    assert np.array_equal(next(find_sequences(tmp_path)).homographies[0], np.eye(3))
    np.savetxt(folder / pattern, H)
    (sequence,) = find_sequences(tmp_path)
    assert (sequence.name, len(sequence.paths)) == ("wall", 2)
    np.testing.assert_array_equal(sequence.homographies[0], H)
    (folder / pattern).write_text("1 2 3")
    with pytest.raises(SourceError, match="homography"):
        list(find_sequences(tmp_path))
    np.savetxt(folder / pattern, np.diag([1.0, 0.0, 1.0]))
    with pytest.raises(SourceError, match="singular"):
        list(find_sequences(tmp_path))
    np.savetxt(folder / pattern, H)
    cv2.imwrite(str(folder / "img3.png"), textured())
    with pytest.raises(SourceError, match="missing; every image but the first needs"):
        list(find_sequences(tmp_path))
    with pytest.raises(SourceError, match="absent: does not exist"):
        list(find_sequences(tmp_path / "absent"))
    with pytest.raises(SourceError, match="not a folder"):
        list(find_sequences(folder / "img3.png"))


def test_a_still_view_has_one_size(tmp_path: Path) -> None:
    for index, image in enumerate((textured(), textured()[:, :300])):
        cv2.imwrite(str(tmp_path / f"{index}.png"), image)
    (sequence,) = find_sequences(tmp_path)
    with pytest.raises(SourceError, match=r"1.png: of another size than 0.png"):
        sequence.images()


@pytest.mark.parametrize("name", ["FAST", "AGAST", "BRISK", "ORB", "Star"])
def test_thresholds_fall_until_there_are_enough_points(name: str) -> None:
    dim = (0.04 * textured() + 20).astype(np.uint8)
    few = peers([name], enough=0)[name].detect(dim)
    many = peers([name], enough=500)[name].detect(dim)
    assert len(many) > len(few)


SLOW = ("MSD", "KAZE", "SIICF paper")


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.slow if n in SLOW else ()) for n in peers()]
)
def test_peers_score_one_on_an_unchanged_pair(tmp_path: Path, name: str) -> None:
    paths = tuple(tmp_path / f"{index}.png" for index in (1, 2))
    for path in paths:
        cv2.imwrite(str(path), textured())
    same = Sequence("same", paths, (np.eye(3),))
    scores = evaluate_sequence(same, name, peers([name])[name], "ABD", top=100).scores
    assert scores["A"] == 1.0 and scores["B"] == 1.0
    assert scores["D MMA@3"] > 0.95 and scores["D H@3"] == 1.0


def test_wrong_protocols_and_detectors(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "1.png"), textured())
    same = Sequence("same", (tmp_path / "1.png",), ())
    with pytest.raises(ConfigError, match="protocols"):
        evaluate_sequence(same, "ORB", peers(["ORB"])["ORB"], "X")
    with pytest.raises(ConfigError, match="unknown detector 'AKAZ'; did you mean 'AKAZE'"):
        peers(["AKAZ"])
