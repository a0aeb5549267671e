"""From one raw frame to named views."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from facetcam.config import nearest
from facetcam.errors import ConfigError
from facetcam.geometry import se3
from facetcam.rig import Rig
from facetcam.unwrapping.resampler import Image, Resampler
from facetcam.unwrapping.views import VirtualView, fit_view

Array = NDArray[np.float64]

SEAM_MARGIN = 1.5  # pixels: nearer to a seam, interpolation would mix two views


class Unwrapper:
    """Cuts raw frames into undistorted, upright, un-mirrored views.

    A flat mirror keeps one view point, so each view is exact: a homography after the lens distortion.

    Parameters
    ----------
    rig : Rig
    views : sequence of VirtualView
        The pictures to make.
    margin : float
        Pixels of the raw frame left out along seams and the frame's edge.

    Attributes
    ----------
    views : dict of str to VirtualView
    """

    def __init__(self, rig: Rig, views: Sequence[VirtualView], margin: float = SEAM_MARGIN) -> None:
        self.rig = rig
        self.views = {view.name: view for view in views}
        usable = UsablePixels(rig, margin)
        maps = [usable.find(view.name, view.T_rig_view[:3, 3] + view.rays()) for view in views]
        self._resample = Resampler([pixels for pixels, _ in maps], [valid for _, valid in maps], rig.size)

    def __call__(self, image: Image) -> dict[str, Image]:
        """Unwrap a raw frame (h, w) or (h, w, 3) of uint8, uint16 or float32.

        Returns
        -------
        dict of str to array
            One picture a view, of the frame's type; black where the view sees nothing.

        Raises
        ------
        SourceError
            If the frame has not the size of the rig's camera, or another type.
        """
        return dict(zip(self.views, self._resample(image)))

    def mask(self, view: str) -> NDArray[np.uint8]:
        """Pixels of a picture that the view sees as 255, (height, width)."""
        return self._resample.valid[list(self.views).index(view)].astype(np.uint8) * 255


class UsablePixels:
    """Looks up points on the raw frame, further than `margin` pixels from the seams of their view."""

    def __init__(self, rig: Rig, margin: float) -> None:
        self._rig = rig
        self._labels = np.where(rig.mask(margin) > 0, rig.labels(), -1)

    def find(self, view: str, points: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Raw pixels (..., 2) of points (..., 3) of the rig frame, and which of them the view shows."""
        rig = self._rig
        points_view = se3.transform(se3.inverse(rig.T_rig_view(view)), points.reshape(-1, 3))
        pixels, valid = rig.view_camera(view).project(points_view)
        if rig.is_flipped(view):
            pixels[:, 0] = rig.camera.width - 1 - pixels[:, 0]
        column, row = np.clip(np.rint(pixels).astype(np.intp), 0, np.array(rig.size) - 1).T
        shown: NDArray[np.bool_] = valid & (self._labels[row, column] == rig.view_names.index(view))
        return pixels.reshape(*points.shape[:-1], 2), shown.reshape(points.shape[:-1])


def unwrap(
    rig: Rig,
    size: tuple[int, int] | None = None,
    fov: float | None = None,
    views: Sequence[str] | None = None,
    margin: float = SEAM_MARGIN,
) -> Unwrapper:
    """Prepare the unwrapping of a rig's frames.

    Parameters
    ----------
    rig : Rig
    size : tuple of int, optional
        Width and height of every picture in pixels; by default each view keeps the raw frame's resolution.
    fov : float, optional
        Horizontal field of view of every picture in radians; by default all that the view sees, up to 120
        degrees.
    views : sequence of str, optional
        Names of the views wanted; by default all.
    margin : float
        Pixels of the raw frame left out along seams and the frame's edge.

    Returns
    -------
    Unwrapper
        Call it with a frame.

    Raises
    ------
    ConfigError
        On an unknown view or an impossible size or field of view.

    Examples
    --------
    >>> pictures = unwrap(Rig.load("preset:ryu"), size=(640, 480))(frame)  # doctest: +SKIP
    """
    names = rig.view_names if views is None else tuple(views)
    for name in names:
        if name not in rig.views:
            raise ConfigError(f"view '{name}': the rig has none of this name; {nearest(name, rig.views)}")
    return Unwrapper(rig, [fit_view(rig, name, size, fov) for name in names], margin)
