"""SLAM frame by frame on the built-in room: where the rig is, and whether its metre is to be trusted."""

import numpy as np

import facetcam
from facetcam.rig import presets
from facetcam.simulation import drive, film, room

FRAMES = 18

rig = presets.ryu()
path = drive.round_the_table(FRAMES)
scene = film.renderer_of(room.furnished_room())
wheels = drive.wheel_odometry(path)  # optional: x, y, yaw in a frame that drifts
slam = facetcam.Slam(rig)

for time, frame, odometry in zip(path.times, film.Film(rig, scene, path), wheels, strict=True):
    state = slam.track(frame, time, tuple(odometry))
    measured = sum(view.inliers for view in state.views.values())
    print(f"{time:4.1f} s  {state.status.name:10} {measured:4} of {state.map_points:4} map points measured")

slam.finish()  # the last adjustment; it also places the frames of the start
times, poses = slam.trajectory()
length = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1).sum()
print(f"{len(times)} of {FRAMES} frames have a pose; the path is {length:.2f} long")
print(f"{'METRIC' if slam.metric else 'NOT METRIC'}, scale known to {100 * slam.scale_sigma:.2g} %")
