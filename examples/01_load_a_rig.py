"""A rig: one camera, flat mirrors, and the views that chains of mirrors give."""

import numpy as np

from facetcam.rig import presets

rig = presets.ryu()  # or facetcam.Rig.load("rig.yaml")
labels = rig.labels()

for index, name in enumerate(rig.view_names):
    chain = " -> ".join(rig.views[name].mirrors) or "direct"
    share = np.mean(labels == index)
    centre = 1000 * rig.T_rig_view(name)[:3, 3]
    print(f"{name:6} over {chain:14} {100 * share:4.1f} % of the frame, centre at {np.round(centre, 1)} mm")

# Every view has one centre, and the centres differ: that is where metric scale comes from.
centres = np.array([rig.T_rig_view(name)[:3, 3] for name in rig.view_names])
apart = np.linalg.norm(centres[:, None] - centres[None], axis=-1)
print(f"the centres are up to {1000 * apart.max():.0f} mm apart")

# A point two metres in front of the rig: where is it on the sensor?
pixels, visible = rig.project("front", [[0.0, 2.0, 0.1]])
print(f"a point 2 m ahead is seen at pixel {np.round(pixels[0], 1)}, visible: {visible[0]}")
