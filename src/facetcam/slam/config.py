"""Parameters of tracking and mapping; the defaults serve every rig and film."""

from __future__ import annotations

from dataclasses import dataclass

from facetcam.config import require_ranges

# Ends between which each number has a meaning.
_RANGES = {
    "features": (50, 50_000),
    "seam_margin": (0.0, 100.0),
    "measured_points": (50, 50_000),
    "min_inliers": (6, 1000),
    "min_correlation": (0.0, 1.0),
    "max_shift": (0.5, 50.0),
    "pixel_sigma": (0.01, 10.0),
    "gate": (0.1, 50.0),
    "match_distance": (1, 256),
    "match_ratio": (0.1, 1.0),
    "search_radius": (0.001, 1.0),
    "min_parallax": (0.0, 0.5),
    "keyframe_parallax": (0.001, 10.0),
    "keyframe_angle": (0.01, 3.2),
    "keyframe_overlap": (0.0, 1.0),
    "keyframe_points": (0, 100_000),
    "window": (3, 100),
    "odometry_sigma": (1e-4, 10.0),
    "metric_sigma": (0.0, 1.0),
}


@dataclass(frozen=True, slots=True)
class SlamConfig:
    """Parameters of `Slam`.

    Numbers beyond where they have a meaning raise `ConfigError`.

    Attributes
    ----------
    features : int
        Corners sought in a frame, over all views.
    seam_margin : float
        Pixels to stay away from seams between views.
    measured_points : int
        Map points measured in a frame, at most; every view has an equal share.
    min_inliers : int
        Measurements below which a frame has no pose.
    min_correlation : float
        Normalised correlation below which a patch is not the map point.
    max_shift : float
        Pixels between prediction and measurement that patch alignment may bridge.
    pixel_sigma : float
        Typical error of a measurement in pixels; scale of the robust kernels.
    gate : float
        Residual in pixels beyond which a measurement is wrong.
    match_distance : int
        Hamming distance beyond which descriptors never match.
    match_ratio : float
        Distance of the best match over that of the second best, at most.
    search_radius : float
        Pixels round a prediction in which descriptors are sought, in units of the frame's width.
    min_parallax : float
        Angle in radians between two rays that give a point its depth.
    keyframe_parallax : float
        Motion since the last keyframe over the median depth that asks for a new one.
    keyframe_angle : float
        Turn in radians that asks for a new keyframe.
    keyframe_overlap : float
        Share of the last keyframe's measurements still found, below which a new one is made.
    keyframe_points : int
        Map points in sight, below which a small motion asks for a new keyframe, before these are lost.
    window : int
        Keyframes adjusted together.
    odometry_sigma : float
        Relative error of odometry between keyframes; loose, since wheels slip and their scale drifts.
    metric_sigma : float
        Relative scale error below which the map is called metric.
    refine_rig : bool
        At the end, let the rig's own numbers move with the map, held by the covariance of their calibration,
        or by the tolerance of a careful build.
    real_time : bool
        Map in a thread of its own, and drop frames that come faster than they can be tracked; results then
        depend on the machine. Otherwise every run gives the same result.
    """

    features: int = 1200
    seam_margin: float = 8.0
    measured_points: int = 800
    min_inliers: int = 15
    min_correlation: float = 0.8
    max_shift: float = 8.0
    pixel_sigma: float = 0.5
    gate: float = 3.0
    match_distance: int = 64
    match_ratio: float = 0.85
    search_radius: float = 0.05
    min_parallax: float = 0.005
    keyframe_parallax: float = 0.08
    keyframe_angle: float = 0.15
    keyframe_overlap: float = 0.8
    keyframe_points: int = 150
    window: int = 8
    odometry_sigma: float = 0.3
    metric_sigma: float = 0.02
    refine_rig: bool = False
    real_time: bool = False

    def __post_init__(self) -> None:
        require_ranges("settings of SLAM", self, **_RANGES)
