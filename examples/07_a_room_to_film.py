"""The built-in room without its table becomes room.glb, a scene for `facetcam simulate`."""

import cv2
import numpy as np
import trimesh
from PIL import Image
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from facetcam.simulation.meshes import Material, quad
from facetcam.simulation.room import furnished_room

scene = trimesh.Scene()
for surface in furnished_room().surfaces:
    middle = surface.corner + surface.right / 2 + surface.down / 2
    if np.abs(middle[:2]).max() < 1.0 and 0.02 < middle[2] < 1.0:
        continue  # the table: it would hide the boards
    small = cv2.resize(surface.picture, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    picture = surface.picture if min(surface.picture.shape[:2]) < 64 else small
    q = quad(surface.corner, surface.right, surface.down, Material(picture))
    material = PBRMaterial(baseColorTexture=Image.fromarray(picture), metallicFactor=0.0)
    visual = TextureVisuals(uv=q.uv * (1, -1) + (0, 1), material=material)
    scene.add_geometry(trimesh.Trimesh(q.vertices, q.faces, visual=visual, process=False))
scene.export("room.glb")
print(f"room.glb: {len(scene.geometry)} surfaces")
