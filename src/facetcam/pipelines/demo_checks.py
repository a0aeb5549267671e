"""What the demo measures against the truth of its scene."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from facetcam.evaluation import trajectory as evaluation
from facetcam.evaluation.repeatability import one_to_one
from facetcam.features import SIICF
from facetcam.pipelines.demo_views import ViewPair
from facetcam.pipelines.summary import Summary
from facetcam.simulation.drive import wheel_odometry
from facetcam.simulation.film import Film
from facetcam.simulation.room import LAMP_OFF_AT
from facetcam.slam.odometry.planar import planar_pose
from facetcam.viz.report import Check

Array = NDArray[np.float64]

PSNR = 35.0  # decibels
SEAM_MARGIN = 12.0  # pixels


def trajectory_checks(summary: Summary, film: Film) -> list[Check]:
    """Tracking, and its errors beside those of the wheels alone."""
    tracked = Check(
        "frames tracked", f"{summary.tracked} of {summary.frames}", "all", summary.tracked == summary.frames
    )
    if summary.errors is None:
        return [tracked]
    errors, drive = summary.errors, film.drive
    alone = np.array([planar_pose(row) for row in wheel_odometry(drive)])
    drift = evaluation.ate(alone[:, :3, 3], drive.poses[:, :3, 3], with_scale=False).rmse
    return [
        tracked,
        _below("path error, rigid alignment", errors.ate.rmse, 0.02, "m"),
        _below("path error, scale aligned too", errors.ate_scaled.rmse, 0.02, "m"),
        _below("error of the scale", abs(100 * errors.scale_error), 1.0, "%"),
        _below("turn error from frame to frame", math.degrees(errors.rpe_rotation.rmse), 0.1, "degrees"),
        Check("path error of the wheels alone", f"{drift:.3f} m", "larger", drift > errors.ate.rmse),
    ]


def view_check(pairs: Sequence[ViewPair]) -> Check:
    """Agreement of unwrapped views with pictures taken directly."""
    worst = min(pairs, key=lambda pair: pair.psnr)
    value = f"{worst.psnr:.1f} dB or better"
    return Check("unwrapped against direct views", value, f"≥ {PSNR:g} dB", worst.psnr >= PSNR)


def light_checks(film: Film, index: int) -> list[Check]:
    """Corners found again from the same place after a lamp went off."""
    detector, mask = SIICF.create(), film.rig.mask(SEAM_MARGIN)
    exposure = film.exposure(index, 0.0)  # the camera has not yet noticed
    lit, dim = (detector.detect(film.still(index, t, exposure), mask) for t in (0.0, LAMP_OFF_AT + 1.0))
    again = one_to_one(lit, dim, np.eye(3), (film.rig.size, film.rig.size))
    found = Check(
        "corners found again, a lamp off",
        f"{100 * again.score:.0f} % of {again.count}",
        "≥ 70 %",
        again.score >= 0.7,
    )
    return [found, _below("their mean distance", again.error, 0.5, "pixels")]


def _below(quantity: str, value: float, limit: float, unit: str) -> Check:
    return Check(quantity, f"{value:.3g} {unit}", f"≤ {limit:g} {unit}", value <= limit)
