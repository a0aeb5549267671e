"""A map as a COLMAP model: one rig, a frame a keyframe, an image a view, and the points that they share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from facetcam.geometry import se3
from facetcam.io.outputs import writing
from facetcam.io.virtual_cameras import colmap_camera
from facetcam.rig import Rig

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class RigFrame:
    """What a rig saw from one place.

    Attributes
    ----------
    timestamp : float
        Seconds.
    T_world_rig : (4, 4) array
    view, point : (N,) int arrays
        View index of the rig and row of the point, of every observation.
    pixels : (N, 2) array
        On the raw frame.
    """

    timestamp: float
    T_world_rig: Array
    view: NDArray[np.integer]
    point: NDArray[np.integer]
    pixels: Array


def write_colmap_model(
    folder: Path, rig: Rig, frames: Sequence[RigFrame], xyz: Array, colour: NDArray[np.uint8]
) -> None:
    """Write a COLMAP model (`cameras.bin`, `rigs.bin`, `frames.bin`, `images.bin`, `points3D.bin`).

    The image of a view is called `VIEW/TIMESTAMP.png`; it is the raw frame, flipped left to right where the
    view lies behind an odd number of mirrors. Half a pixel is added, since COLMAP's (0, 0) is the corner of
    the first pixel.

    Parameters
    ----------
    folder : Path
        Made where it is absent.
    rig : Rig
    frames : sequence of RigFrame
    xyz, colour : (M, 3) arrays
        World positions and RGB colours of the points.

    Raises
    ------
    OutputError
        If the folder or a file cannot be written.
    """
    model = _rig_model(rig)
    tracks: list[list[tuple[int, int]]] = [[] for _ in range(len(xyz))]
    for index, frame in enumerate(frames, start=1):
        _add_frame(model, rig, index, frame, tracks)
    _add_points(model, xyz, colour, tracks)
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        model.write_binary(str(folder))


def _rig_model(rig: Rig) -> Any:
    """A model with one camera a view, tied to a rig by the first one."""
    import pycolmap

    model, layout = pycolmap.Reconstruction(), pycolmap.Rig(rig_id=1)
    reference = rig.T_rig_view(rig.view_names[0])
    for number, name in enumerate(rig.view_names, start=1):
        kind, params = colmap_camera(rig.view_camera(name))
        width, height = rig.size
        camera = pycolmap.Camera(camera_id=number, model=kind, width=width, height=height, params=params)
        model.add_camera(camera)
        if number == 1:
            layout.add_ref_sensor(camera.sensor_id)
        else:
            layout.add_sensor(camera.sensor_id, _rigid(se3.inverse(rig.T_rig_view(name)) @ reference))
    model.add_rig(layout)
    return model


def _add_frame(
    model: Any, rig: Rig, index: int, frame: RigFrame, tracks: list[list[tuple[int, int]]]
) -> None:
    """Add a frame with an image for each view, and note which of its points belong to which track."""
    import pycolmap

    n_views = len(rig.view_names)
    T_reference_world = se3.inverse(frame.T_world_rig @ rig.T_rig_view(rig.view_names[0]))
    moment = pycolmap.Frame(frame_id=index, rig_id=1)
    moment.rig_from_world = _rigid(T_reference_world)
    images = []
    for view, name in enumerate(rig.view_names):
        rows = np.flatnonzero(frame.view == view)
        pixels = frame.pixels[rows] + 0.5
        if rig.is_flipped(name):
            pixels[:, 0] = rig.size[0] - pixels[:, 0]
        image = pycolmap.Image(
            name=f"{name}/{frame.timestamp:.6f}.png",
            keypoints=pixels,
            camera_id=view + 1,
            image_id=(index - 1) * n_views + view + 1,
        )
        image.frame_id = index
        moment.add_data_id(image.data_id)
        images.append(image)
        for at, point in enumerate(frame.point[rows].tolist()):
            tracks[point].append((image.image_id, at))
    model.add_frame(moment)
    for image in images:
        model.add_image(image)


def _add_points(
    model: Any, xyz: Array, colour: NDArray[np.uint8], tracks: list[list[tuple[int, int]]]
) -> None:
    import pycolmap

    for position, rgb, seen in zip(xyz, colour, tracks):
        if seen:
            track = pycolmap.Track([pycolmap.TrackElement(image, at) for image, at in seen])
            model.add_point3D(position, track, rgb)


def _rigid(T: Array) -> Any:
    import pycolmap

    R = se3.assert_proper_rotation(T[:3, :3], "pose for COLMAP", 1e-5)
    return pycolmap.Rigid3d(pycolmap.Rotation3d(R), T[:3, 3])
