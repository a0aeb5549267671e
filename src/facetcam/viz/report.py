"""What a report shows, as plain arrays: the pages know nothing of how a run was made.

The pipelines gather arrays into a `SlamReport`, `DemoReport` or `UnwrapReport`, and `facetcam.viz.pages`
writes it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]


def no_positions() -> Array:
    return np.empty((0, 3))


@dataclass(frozen=True, slots=True)
class Picture:
    """An image with the points found in it.

    `image` is grey or BGR, 8 or 16 bit; `points` (N, 2) are its pixels x, y; `views` (N,) number their views.
    """

    caption: str
    image: NDArray[np.generic]
    points: Array = field(default_factory=lambda: np.empty((0, 2)))
    views: NDArray[np.integer] = field(default_factory=lambda: np.empty(0, np.int8))


@dataclass(frozen=True, slots=True)
class Truth:
    """The true path beside the estimate: `positions` (M, 3) at its times, laid over it, in its unit.

    `errors` (M,) are the distances of the aligned estimate to the truth in metres.
    `ate` is the absolute trajectory error (root mean square, m) after a rigid alignment, `ate_scaled` after
    one with scale; `with_scale` says which of the two alignments `positions` and `errors` went through.
    """

    positions: Array
    errors: Array
    ate: float
    ate_scaled: float
    with_scale: bool


@dataclass(frozen=True, slots=True)
class SlamReport:
    """A SLAM run of N frames, V views, M poses, K keyframes and P map points; metres and seconds."""

    title: str
    view_names: Sequence[str]
    times: Array  # (N,)
    statuses: Sequence[str]  # (N,) names of slam.Status
    predicted: NDArray[np.integer]  # (N, V) map points expected in each view
    inliers: NDArray[np.integer]  # (N, V) map points measured in each view
    tracked: int  # frames with a measured pose, those of the start included
    metric: bool
    scale_sigma: float  # relative; inf when unknown
    pose_times: Array = field(default_factory=lambda: np.empty(0))  # (M,)
    positions: Array = field(default_factory=no_positions)  # (M, 3)
    keyframes: Array = field(default_factory=no_positions)  # (K, 3)
    cloud: Array = field(default_factory=no_positions)  # (P, 3)
    # times and positions, by a name, of the paths in maps that never met this one
    apart: Mapping[str, tuple[Array, Array]] = field(default_factory=dict)
    timing: Mapping[str, Sequence[float]] = field(default_factory=dict)  # seconds a call of each stage
    pictures: Sequence[Picture] = ()  # raw frames with their tracks
    truth: Truth | None = None
    rig_denied: bool = False  # the images are sure of another rig
    interrupted: str = ""  # the reason; empty when the run went to its end
    facts: Mapping[str, str] = field(default_factory=dict)  # further rows of the summary


@dataclass(frozen=True, slots=True)
class Check:
    """One row of the table against truth: a quantity, its value, what it should be, and whether it is."""

    quantity: str
    value: str
    expected: str
    passed: bool


@dataclass(frozen=True, slots=True)
class DemoReport:
    """The whole line on a built-in scene: the SLAM run, unwrapped views with their corners, the checks."""

    slam: SlamReport
    frame: Picture  # one raw frame
    views: Sequence[Picture]  # its unwrapped views with detected corners
    checks: Sequence[Check]
    title: str = "A drive round a furnished room"


@dataclass(frozen=True, slots=True)
class UnwrapReport:
    """A contact sheet: some frames in rows, or each with its unwrapped views."""

    title: str
    rows: Sequence[Sequence[Picture]]
    interrupted: str = ""
    facts: Mapping[str, str] = field(default_factory=dict)
    kind: str = "Unwrapped views"
