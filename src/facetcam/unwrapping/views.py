"""Virtual cameras: upright and un-mirrored, each at the true centre of a view."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml
from numpy.typing import NDArray

from facetcam.errors import ConfigError, OutputError
from facetcam.geometry import se3
from facetcam.rig import Camera, Rig

Array = NDArray[np.float64]

WIDEST = math.radians(120.0)  # a flat picture stretches its corners; wider views are cut
UPRIGHT_LIMIT = math.cos(math.radians(15.0))  # closer to the rig's z axis than this, "up" means nothing

_GRID = 16  # pixels between the samples inside a view; its outline is sampled fully
_CENTRINGS = 10


@dataclass(frozen=True, eq=False)
class VirtualView:
    """A pinhole camera that stands in the centre of a view and looks where the view looks.

    Attributes
    ----------
    name : str
        The view of the rig.
    camera : Camera
        Without distortion.
    T_rig_view : (4, 4) array
        Proper pose in the rig frame, metres; the picture is upright where the rig's z axis can be seen as up.
    flipped : bool
        True where the raw frame shows this view as a mirror image; the unwrapped picture never is one.
    """

    name: str
    camera: Camera
    T_rig_view: Array
    flipped: bool

    def rays(self) -> Array:
        """Unit directions (H, W, 3) in the rig frame of all pixels."""
        v, u = np.indices((self.camera.height, self.camera.width), dtype=np.float64)
        rays: Array = self.camera.ray(np.stack([u, v], axis=-1)) @ self.T_rig_view[:3, :3].T
        return rays.reshape(*u.shape, 3)


def fit_view(rig: Rig, name: str, size: tuple[int, int] | None, fov: float | None) -> VirtualView:
    """Choose the virtual camera of a view.

    Parameters
    ----------
    rig : Rig
    name : str
    size : tuple of int or None
        Width and height of the picture; None keeps the resolution of the raw frame.
    fov : float or None
        Horizontal field of view in radians; None shows all that the view sees, up to `WIDEST`.
    """
    if fov is not None and not 0.0 < fov < math.pi:
        raise ConfigError(f"fov: {fov:g} rad must lie between 0 and pi")
    if size is not None and min(size) < 2:
        raise ConfigError(f"size: {size[0]}x{size[1]} must be two pixels or more a side")
    directions = seen_directions(rig, name)
    R, reach = _centred(rig, name, directions)
    if fov is not None:
        reach[0] = math.tan(fov / 2)
    T_rig_view = se3.from_rotation_translation(R, rig.T_rig_image(name)[:3, 3])
    return VirtualView(name, _camera(rig.camera, reach, size, fov), T_rig_view, rig.is_flipped(name))


def write_views(views: Iterable[VirtualView], path: Path) -> None:
    """Write `views.yaml`: each view's pinhole camera, proper pose, and whether the raw image is mirrored.

    Raises
    ------
    OutputError
        If the file exists or cannot be written.
    """
    text = yaml.safe_dump(
        {v.name: _entry(v) for v in views}, sort_keys=False, default_flow_style=None, width=120
    )
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror})") from error


def _entry(view: VirtualView) -> dict[str, Any]:
    camera = view.camera
    numbers = {key: getattr(camera, key) for key in ("width", "height", "fx", "fy", "cx", "cy")}
    return {**numbers, "T_rig_view": view.T_rig_view.tolist(), "flipped": view.flipped}


def seen_directions(rig: Rig, name: str) -> Array:
    """Unit directions (N, 3) in the rig frame of the outline of a view and of a grid inside it."""
    own = (rig.labels() == rig.view_names.index(name)).astype(np.uint8)
    samples = own - cv2.erode(own, np.ones((3, 3), np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=0)
    samples[::_GRID, ::_GRID] |= own[::_GRID, ::_GRID]
    v, u = np.nonzero(samples)
    if not len(u):
        raise ConfigError(f"view '{name}': no pixel of the raw frame belongs to it")
    return rig.ray(name, np.column_stack([u, v]))[1]


def _centred(rig: Rig, name: str, directions: Array) -> tuple[Array, Array]:
    """Axes (3, 3) of a camera on which the view lies centred, and its half extent, in tangents."""
    T = rig.T_rig_view(name)
    mean = directions.mean(axis=0)
    forward = mean / np.linalg.norm(mean) if np.linalg.norm(mean) > 0.1 else T[:3, 2]
    if (directions @ forward).max() < math.cos(WIDEST / 2):
        # A ring of pixels on a wide lens has nothing in its middle: look at a part of it.
        forward = directions[np.argmax(directions @ forward)]
    for _ in range(_CENTRINGS):
        R = _axes(forward / np.linalg.norm(forward), T)
        in_view = directions @ R
        in_view = in_view[in_view[:, 2] >= min(math.cos(WIDEST / 2), in_view[:, 2].max())]
        plane = in_view[:, :2] / in_view[:, 2:]
        low, high = plane.min(axis=0), plane.max(axis=0)
        forward = R @ np.append((low + high) / 2, 1.0)
    return R, np.maximum(-low, high)


def _axes(forward: Array, T_rig_view: Array) -> Array:
    """Camera axes as columns: the rig's z is up, or the raw image's up for a view along z."""
    up = np.array([0.0, 0.0, 1.0]) if abs(forward[2]) < UPRIGHT_LIMIT else -T_rig_view[:3, 1]
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    return np.column_stack([right, np.cross(forward, right), forward])


def _camera(raw: Camera, reach: Array, size: tuple[int, int] | None, fov: float | None) -> Camera:
    """Pinhole camera that shows tangents up to `reach`; with a given width and fov the width decides."""
    if size is None:
        focal = (raw.fx + raw.fy) / 2
        width, height = (max(8, 2 * math.ceil(focal * r + 0.5)) for r in reach.tolist())
    else:
        width, height = size
        scales = np.array([width, height]) / 2 / np.maximum(reach, 1e-6)
        focal = float(scales[0] if fov is not None else scales.min())
    centre = (width - 1) / 2, (height - 1) / 2
    return Camera("brown-conrady", width, height, focal, focal, *centre, (0.0,) * 5)
