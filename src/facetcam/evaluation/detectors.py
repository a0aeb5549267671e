"""Scores of detectors on image sequences, by the protocols of docs/benchmarks-detectors.md."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, TypeVar

import cv2
import numpy as np

from facetcam.errors import ConfigError
from facetcam.evaluation.datasets import Sequence
from facetcam.evaluation.matching import matching_accuracy, mutual_nearest
from facetcam.evaluation.overlap import overlap_repeatability
from facetcam.evaluation.peers import Peer
from facetcam.evaluation.repeatability import Points, Size, one_to_one, superpoint
from facetcam.evaluation.synthetic import Change
from facetcam.features.images import Image

Scores = dict[str, float]
Pair = tuple[Image, Image, Points]
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Row:
    """Scores of one detector on one sequence."""

    sequence: str
    detector: str
    scores: Scores


def evaluate_sequence(
    sequence: Sequence, name: str, peer: Peer, protocols: str = "B", top: int = 1000
) -> Row:
    """Average the scores of a detector over the pairs (first image, other image) of a sequence.

    Parameters
    ----------
    protocols : str
        Letters of the protocols, such as "ABCD".
    top : int
        Points of each image that take part in protocols B, C and D.
    """
    first, *others = sequence.images()
    pairs = [(first, other, H) for other, H in zip(others, sequence.homographies, strict=True)]
    return Row(sequence.name, name, score_pairs(pairs, peer, protocols, top))


def evaluate_change(
    images: Iterable[Image],
    name: str,
    change: Change,
    detector: str,
    peer: Peer,
    protocols: str,
    top: int = 500,
) -> Row:
    """Average the scores of a detector over images and their changed copies."""
    pairs = [(image, *change(image)) for image in images]
    return Row(name, detector, score_pairs(pairs, peer, protocols, top))


def score_pairs(pairs: list[Pair], peer: Peer, protocols: str, top: int) -> Scores:
    """Mean scores over pairs of images; ConfigError for a letter that is no protocol."""
    check_protocols(protocols)
    remembering = Peer(_remembered(peer.detect), _remembered(peer.described), peer.norm)
    scores: Scores = {}
    for letter in protocols:
        used = peer if letter == "A" else remembering  # A makes images of its own
        of_pairs = [_PROTOCOLS[letter](pair, used, top) for pair in pairs]
        for key in of_pairs[0]:
            values = np.array([found[key] for found in of_pairs])
            scores[key] = float(np.nanmean(values)) if not np.isnan(values).all() else float("nan")
    return scores


def check_protocols(protocols: str) -> None:
    """Raise ConfigError unless all letters are protocols, and none stands twice."""
    if not protocols or set(protocols) - set(_PROTOCOLS) or len(set(protocols)) < len(protocols):
        raise ConfigError(f"protocols: expected letters of {''.join(_PROTOCOLS)}, got {protocols!r}")


def _remembered(function: Callable[..., T]) -> Callable[..., T]:
    """Keep the results by image and other arguments: the first image of a sequence is in every pair."""
    results: dict[tuple[Any, ...], T] = {}

    def remembered(image: Image, *args: int) -> T:
        key = (id(image), *args)
        if key not in results:
            results[key] = function(image, *args)
        return results[key]

    return remembered


def _size(image: Image) -> Size:
    return image.shape[1], image.shape[0]


def _distance(pair: Pair, peer: Peer, top: int) -> Scores:
    """Protocol A: images of 240x320, the homography to match, the best 300 whatever `top` is."""
    small = (320, 240)
    first, second = (np.asarray(cv2.resize(image, small, interpolation=cv2.INTER_AREA)) for image in pair[:2])
    H = _rescaling(pair[1], small) @ pair[2] @ np.linalg.inv(_rescaling(pair[0], small))
    result = superpoint(peer.detect(first), peer.detect(second), H, (small, small))
    return {"A": result.score, "A px": result.error}


def _rescaling(image: Image, size: Size) -> Points:
    """Homography from an image to its resized copy; (0, 0) is the centre of the first pixel."""
    scale = np.array(size) / _size(image)
    return np.array([[scale[0], 0, (scale[0] - 1) / 2], [0, scale[1], (scale[1] - 1) / 2], [0, 0, 1]])


def _one_to_one(pair: Pair, peer: Peer, top: int) -> Scores:
    first, second = peer.detect(pair[0]), peer.detect(pair[1])
    result = one_to_one(first, second, pair[2], (_size(pair[0]), _size(pair[1])), top)
    return {"B": result.score, "B px": result.error, "points": result.count}


def _overlap(pair: Pair, peer: Peer, top: int) -> Scores:
    first, second = peer.detect(pair[0]), peer.detect(pair[1])
    return {"C": overlap_repeatability(first, second, pair[2], (_size(pair[0]), _size(pair[1])), top).score}


def _matching(pair: Pair, peer: Peer, top: int) -> Scores:
    (first, left), (second, right) = (peer.described(image, top) for image in pair[:2])
    matches = mutual_nearest(left, right, peer.norm)
    a, b = first.xy[matches[:, 0]].astype(np.float64), second.xy[matches[:, 1]].astype(np.float64)
    result = matching_accuracy(a, b, pair[2], _size(pair[0]))
    homography = {f"D H@{t:g}": float(result.corner_error <= t) for t in result.accuracy}
    return {f"D MMA@{t:g}": share for t, share in result.accuracy.items()} | homography


_PROTOCOLS: dict[str, Callable[[Pair, Peer, int], Scores]] = {
    "A": _distance,
    "B": _one_to_one,
    "C": _overlap,
    "D": _matching,
}
