"""Corners that bear a change of light: the same room, lit and four times darker."""

import cv2
import numpy as np

import facetcam
from facetcam.features import match_mutual
from facetcam.rig import presets
from facetcam.simulation import drive, film, room

rig = presets.ryu()
scene = film.renderer_of(room.furnished_room())
frame = next(iter(film.Film(rig, scene, drive.round_the_table(1))))
dark = frame // 4

detector = facetcam.SIICF.create(max_features=800)
mask = rig.mask(margin=8)  # no corners on the seams between the mirrors
keypoints, descriptors = detector.detectAndCompute(frame, mask)
dark_keypoints, dark_descriptors = detector.detectAndCompute(dark, mask)

pairs = match_mutual(descriptors, dark_descriptors)
distance = np.linalg.norm(keypoints.xy[pairs[:, 0]] - dark_keypoints.xy[pairs[:, 1]], axis=1)
print(f"{len(keypoints)} corners in the light, {len(dark_keypoints)} in the dark")
print(f"{np.sum(distance < 3)} of {len(pairs)} matches lie within 3 pixels")

orb = cv2.ORB.create(800)
print(f"ORB, for comparison: {len(orb.detect(frame, mask))} and {len(orb.detect(dark, mask))}")
