"""New map points, before a wall that is drawn: what lies along an edge has no distance."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from slam_worlds import distinct_corners, single

from facetcam.geometry import se3
from facetcam.slam.camera.frame import make_frame
from facetcam.slam.camera.optics import Optics
from facetcam.slam.config import SlamConfig
from facetcam.slam.map.map import Keyframe, Map
from facetcam.slam.mapping.triangulator import Triangulator

Array = NDArray[np.float64]

FAR, ASIDE, FOCAL = 2.0, 0.06, 420.0  # metres, metres, pixels: the wall moves by 12.6 px
SHIFT = FOCAL * ASIDE / FAR
LYING = np.array([[x, 120.0] for x in range(100, 560, 40)])  # on the rims of two bars
UPRIGHT = np.array([[320.0, y] for y in range(190, 430, 20)])
TIPS = np.array([[x, 420.0] for x in (100.0, 180.0, 260.0, 400.0, 480.0)])


def wall(shift: float) -> NDArray[np.uint8]:
    """Four times as fine as it is seen: a lying and an upright bar, and the corners of squares."""
    fine = np.full((4 * 480, 4 * 640), 170, np.uint8)
    boxes = [(-50.0, 120.0, 740.0, 16.0), (320.0, 170.0, 16.0, 290.0), *((x, y, 30.0, 30.0) for x, y in TIPS)]
    for x, y, width, height in boxes:
        corners = np.array([[x, y], [x + width, y], [x + width, y + height], [x, y + height]])
        cv2.fillPoly(fine, [np.rint(4.0 * (corners - [shift, 0.0] + 0.5)).astype(np.int32)], 70)
    seen = cv2.resize(fine, (640, 480), interpolation=cv2.INTER_AREA)
    noise = np.random.default_rng(int(shift)).normal(0.0, 1.0, seen.shape)
    return np.clip(np.rint(seen + noise), 0, 255).astype(np.uint8)


def keyframe(index: int, optics: Optics, corners: Array) -> Keyframe:
    """The wall from so many steps to the right, with its corners where they are seen."""
    pixels = corners - [index * SHIFT, 0.0]
    looks = np.random.default_rng(5).integers(0, 256, (len(corners), 32), dtype=np.uint8)
    views = np.zeros(len(corners), np.int8)
    found = distinct_corners(pixels, views, optics.plane(pixels, views), looks)
    T = se3.exp([0.0, 0.0, 0.0, index * ASIDE, 0.0, 0.0])
    frame = make_frame(wall(index * SHIFT), float(index), (640, 480))
    frame.colours = np.zeros((len(corners), 3), np.uint8)
    made = Keyframe(index, float(index), T, found, frame, None)
    made.free = np.ones(len(corners), np.bool_)
    return made


def test_an_edge_along_the_motion_gives_no_points_and_one_across_does() -> None:
    optics, map, config = Optics(single(), 8.0), Map(), SlamConfig()
    a, b = (keyframe(k, optics, np.concatenate([LYING, UPRIGHT, TIPS])) for k in range(2))
    map.keyframes += [a, b]
    Triangulator(map, optics, config).in_time(b, a, config.gate)
    xyz = map.points.xyz[map.points.alive]
    np.testing.assert_allclose(xyz[:, 1], FAR, rtol=0.02)
    made = FOCAL * xyz[:, [0, 2]] / FAR * [1.0, -1.0] + [319.5, 239.5]
    lying, upright, tips = (
        np.linalg.norm(made[:, None] - group, axis=2).min(axis=0) < 2.0 for group in (LYING, UPRIGHT, TIPS)
    )
    assert not lying.any() and tips.all()
    assert upright.sum() >= len(upright) // 2  # they slide, too, and some too far
