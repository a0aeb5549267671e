"""Errors of a trajectory against the truth: here, what the wheels alone report of a drive."""

import numpy as np

from facetcam.evaluation.trajectory import evaluate
from facetcam.geometry import se3
from facetcam.simulation import drive

path = drive.round_the_table(100)
wheels = drive.wheel_odometry(path)

# The wheels' x axis is the rig's front, its +y: yaw is turned by a quarter to make poses of the rig.
poses = [se3.exp([0.0, 0.0, yaw - np.pi / 2, 0.0, 0.0, 0.0]) for yaw in wheels[:, 2]]
estimate = np.array(poses)
estimate[:, :2, 3] = wheels[:, :2]

errors = evaluate((path.times, estimate), (path.times, path.poses))
print(f"path of {errors.true_length:.1f} m, {errors.matched} poses compared")
print(f"error after rigid alignment    {100 * errors.ate.rmse:5.1f} cm")
print(f"error after alignment of scale {100 * errors.ate_scaled.rmse:5.1f} cm")
print(f"lengths are {100 * errors.scale_error:+.1f} % off")
print(f"turn error from pose to pose   {np.degrees(errors.rpe_rotation.rmse):5.2f} degrees")
