"""A frame of your own scene through mirrors, with the true distance of every pixel."""

import cv2
import numpy as np

from facetcam.rig import presets
from facetcam.simulation.exposures import Exposures
from facetcam.simulation.mesh_renderer import MeshRenderer
from facetcam.simulation.meshes import Material, joined, quad
from facetcam.simulation.scene import Lamp
from facetcam.simulation.sensor import AutoExposure, Sensor
from facetcam.simulation.settings import CameraSettings

# Four walls of tiles round the rig, or facetcam.simulation.scene_files.read_scene(path).mesh
tiles = (np.indices((24, 24)).sum(axis=0) % 2 * 120 + 100).astype(np.uint8).repeat(16, 0).repeat(16, 1)
material = Material(np.repeat(tiles[..., None], 3, axis=2))
walls = []
for angle in np.arange(4) * np.pi / 2:
    away, right = np.array([-np.sin(angle), np.cos(angle), 0]), np.array([np.cos(angle), np.sin(angle), 0])
    walls.append(quad(1.5 * (away - right) + [0, 0, 1.5], 3 * right, np.array([0, 0, -3.0]), material))
scene = MeshRenderer(joined(walls), lamps=(Lamp((0.0, 0.0, 1.2), 1.5),))

rig = presets.ryu()
camera = Exposures(rig, scene, CameraSettings(samples=2))
radiance = camera.radiance(lambda time: np.eye(4), time=0.0)
frame = Sensor().develop(radiance, AutoExposure().follow(radiance, 0.0), np.random.default_rng(0))
cv2.imwrite("frame.png", frame)

depth, labels = camera.depth(np.eye(4)), rig.labels()
for index, name in enumerate(rig.view_names):
    near, far = np.percentile(depth[labels == index], [0, 100])
    print(f"{name:6} sees walls {near:.2f} to {far:.2f} m along the ray from the lens")
