"""One raw frame of the built-in room becomes four upright, un-mirrored views."""

from pathlib import Path

import cv2

import facetcam
from facetcam.rig import presets
from facetcam.simulation import drive, film, room

rig = presets.ryu()
scene = film.renderer_of(room.furnished_room())
frame = next(iter(film.Film(rig, scene, drive.round_the_table(1))))

unwrapper = facetcam.unwrap(rig, size=(640, 480))  # the maps are made once, then used for every frame
out = Path("views")
out.mkdir(exist_ok=True)
for name, view in unwrapper(frame).items():
    cv2.imwrite(str(out / f"{name}.png"), view)
    print(f"{out / name}.png: {view.shape[1]} x {view.shape[0]}")
