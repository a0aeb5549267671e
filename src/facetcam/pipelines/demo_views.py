"""The unwrapped views of one frame of the demo, beside pictures taken directly from their places."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam.features import SIICF
from facetcam.rig import Rig, View
from facetcam.simulation.exposures import Exposures
from facetcam.simulation.film import Film
from facetcam.simulation.sensor import AutoExposure
from facetcam.unwrapping import unwrap
from facetcam.viz.report import Picture

Image = NDArray[np.uint8]

MARGIN = 4.0  # pixels of the raw frame along seams
CORNERS = 200
EDGE = 15  # pixels of the window that must lie inside the view


@dataclass(frozen=True, eq=False, slots=True)
class ViewPair:
    """An unwrapped view, a picture taken from its place without mirrors, and where the two compare."""

    name: str
    unwrapped: Image
    direct: Image
    mask: Image

    @property
    def psnr(self) -> float:
        """Agreement within the mask in decibels of the peak signal-to-noise ratio."""
        seen = self.mask > 0
        error = self.unwrapped[seen].astype(np.float64) - self.direct[seen]
        return float(10.0 * np.log10(255.0**2 / max(float(np.mean(error**2)), 1e-6)))

    def picture(self, index: int) -> Picture:
        """The unwrapped view with its corners, in the colour of view `index`."""
        # Where a mirror ends there is an edge, but none of the room.
        inside = cv2.erode(self.mask, np.ones((EDGE, EDGE), np.uint8), borderValue=0)
        corners = SIICF.create(max_features=CORNERS).detect(self.unwrapped, inside)
        return Picture(
            f"{self.name}: {len(corners)} corners",
            self.unwrapped,
            corners.xy,
            np.full(len(corners), index, np.int8),
        )


def view_pairs(film: Film, index: int, time: float = 0.0) -> list[ViewPair]:
    """Unwrap the frame `index` without noise, and render each of its views directly."""
    pose, sensor = film.drive.poses[index], film.sensor
    radiance = film.radiance(index, time)
    exposure = AutoExposure().follow(radiance, time)
    unwrapper = unwrap(film.rig, margin=MARGIN)
    pairs = []
    for name, image in unwrapper(sensor.develop(radiance, exposure)).items():
        view = unwrapper.views[name]
        camera = Rig(view.camera, view.T_rig_view, {}, {"direct": View()})
        direct = Exposures(camera, film.renderer, film.settings)
        light = direct.radiance(lambda moment: pose, time)
        pairs.append(ViewPair(name, image, sensor.develop(light, exposure), unwrapper.mask(name)))
    return pairs
