"""The rig: one camera, flat mirrors, and the views that chains of mirrors give."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from facetcam.errors import FacetcamError, RigError
from facetcam.geometry import glass, reflection, se3
from facetcam.rig.camera import Camera
from facetcam.rig.covariance import RigCovariance
from facetcam.rig.mirrors import Mirror
from facetcam.rig.view import View, check_views
from facetcam.rig.visibility import Visibility

Array = NDArray[np.float64]

_LARGEST = 50.0  # metres across a bounded mirror


@dataclass(frozen=True, eq=False)
class Rig:
    """A camera that looks into flat mirrors: a generalised camera with one centre a view.

    Parameters
    ----------
    camera : Camera
    T_rig_cam : (4, 4) array
        Pose of the real camera in the rig frame (z up, y front, x right), metres.
    mirrors : mapping of name to Mirror
    views : mapping of name to View
    covariance : RigCovariance, optional
        How well a calibration knows the numbers.
    solved_from : str, optional
        Digest of the photos' corners, boards and drawing that the calibration came from.

    Raises
    ------
    RigError
        If the pose is not a rigid motion, or a view names a mirror that is absent.
    """

    camera: Camera
    T_rig_cam: Array
    mirrors: Mapping[str, Mirror] = field(default_factory=dict)
    views: Mapping[str, View] = field(default_factory=lambda: {"front": View()})
    covariance: RigCovariance | None = None
    solved_from: str | None = None

    def __post_init__(self) -> None:
        check_pose(self.T_rig_cam)
        check_views(self.mirrors, self.views)
        if self.covariance is not None:
            self.covariance.check(self.mirrors)

    @classmethod
    def load(cls, path: str | Path) -> Rig:
        """Read and check a `rig.yaml`, or make a preset: `preset:ryu`, `preset:pyramid`, `preset:table`.

        Raises
        ------
        RigError
            If the file cannot be used; one line that says where and why.
        """
        from facetcam.rig import files, presets

        name = str(path)
        if name.startswith(presets.PREFIX):
            return presets.by_name(name.removeprefix(presets.PREFIX))
        return files.read_rig(Path(path))

    def save(self, path: str | Path) -> None:
        """Write a `rig.yaml`; an existing file is not replaced."""
        from facetcam.rig.files import write_rig

        write_rig(self, Path(path))

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the raw frame in pixels."""
        return self.camera.width, self.camera.height

    @cached_property
    def view_names(self) -> tuple[str, ...]:
        """Names of the views, in the order of their indices."""
        return tuple(self.views)

    @cached_property
    def _visibility(self) -> Visibility:
        return Visibility(self.camera, self.T_rig_cam, self.mirrors, self.views)

    @cached_property
    def digest(self) -> str:
        """SHA-256 of all that the rig's file says; tells whether results came from the same rig."""
        from facetcam.rig import files

        return files.digest(self)

    def T_rig_image(self, view: str) -> Array:
        """Pose of the virtual camera of the raw image: S_k ... S_1 T_rig_cam, of determinant (-1)^k.

        A view through glass (`Mirror.glass`) has no exact centre: `project` and `ray` take every ray as it
        runs, and this pose, as all that is built on it, stands in with the centre of the view's middle ray.
        """
        T = self._folded(view)
        if self._visibility.glass(view) is not None:
            T[:3, 3] += T[:3, :3] @ self._visibility.middle_displacement(view)
        return T

    def _folded(self, view: str) -> Array:
        """Product of the reflections in the front faces and of the camera's pose."""
        reflections = [self.mirrors[name].reflection for name in self.views[view].mirrors]
        return reflection.chain(reflections) @ self.T_rig_cam

    def is_flipped(self, view: str) -> bool:
        """Tell whether the view is a mirror image on the raw frame (an odd chain)."""
        return len(self.views[view].mirrors) % 2 == 1

    def T_rig_view(self, view: str) -> Array:
        """Proper pose (4, 4) of the virtual camera; for odd chains of the image flipped left to right."""
        T = self.T_rig_image(view)
        return T @ reflection.FLIP_X if self.is_flipped(view) else T

    def view_camera(self, view: str) -> Camera:
        """Intrinsics that belong to `T_rig_view`: the real camera, mirrored for odd chains."""
        return self.camera.mirrored() if self.is_flipped(view) else self.camera

    def project(self, view: str, points: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
        """Project points (N, 3) of the rig frame into one view.

        Returns
        -------
        pixels : (N, 2) array
            Raw-frame pixels; zero where the point does not project.
        visible : (N,) bool array
            True where light from the point reaches the sensor through this chain of mirrors, unobstructed
            by any mirror.
        """
        T = self._folded(view)
        points = np.reshape(points, (-1, 3))
        # What is not finite goes into the lens, where nothing is visible.
        points = np.where(np.isfinite(points).all(axis=1, keepdims=True), points, T[:3, 3])
        points_cam = se3.transform(se3.inverse(T), points)
        panes = self._visibility.glass(view)
        if panes is not None:
            points_cam, found = glass.straightened(points_cam, *panes)
            points_cam[~found] = 0.0
        pixels, valid = self.camera.project(points_cam)
        visible = valid & self._visibility.reaches(view, points_cam) & self.views[view].covers(pixels)
        return pixels, visible

    def ray(self, view: str, pixels: ArrayLike) -> tuple[Array, Array]:
        """Rays of raw pixels (N, 2) seen through one view.

        Returns
        -------
        origins : (N, 3) array
            The view's virtual centre, repeated; through glass each ray has its own.
        directions : (N, 3) array
            Unit directions in the rig frame; zero where the lens gives the pixel no ray.
        """
        T = self._folded(view)
        rays = self.camera.ray(pixels)
        panes = self._visibility.glass(view)
        offsets = np.zeros_like(rays) if panes is None else glass.displacement(rays, *panes) @ T[:3, :3].T
        return T[:3, 3] + offsets, rays @ T[:3, :3].T

    def sees(self, view: str, pixels: ArrayLike) -> NDArray[np.bool_]:
        """Tell which raw pixels (N, 2) see the room through this view's chain.

        A bounded mirror behind the chain hides the room; an unbounded one stands for a wall of unknown
        extent, before which objects are seen.
        """
        return self._visibility.sees(view, np.asarray(pixels, dtype=np.float64).reshape(-1, 2))

    def labels(self) -> NDArray[np.int8]:
        """Index of the view of every raw pixel, (height, width); NO_VIEW where no view sees the room.

        Where several chains share a pixel (unbounded mirrors without regions) the longest one wins.
        """
        return self._visibility.label_map.copy()

    def mask(self, margin: float = 0.0) -> NDArray[np.uint8]:
        """Valid raw pixels as 255, (height, width): more than `margin` pixels from seams and the border."""
        if not margin >= 0:
            raise RigError(f"mask: the margin of {margin:g} pixels must be zero or more")
        inside = np.zeros(self._visibility.label_map.shape, dtype=np.uint8)
        for index in range(len(self.views)):
            # The padding makes the frame's edge count as a seam.
            area = np.pad((self._visibility.label_map == index).astype(np.uint8), 1)
            distance = cv2.distanceTransform(area, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1]
            inside[distance > margin] = 255
        return inside

    def check(self) -> None:
        """Raise RigError, with the reason, if a view has no pixel on the raw frame that sees the room.

        Or if a mirror is so large that its file must be in millimetres.
        """
        for name, mirror in self.mirrors.items():
            if (
                mirror.polygon is not None
                and (size := float(np.ptp(mirror.polygon, axis=0).max())) > _LARGEST
            ):
                raise RigError(f"mirror '{name}' would be {size:g} m wide; give its corners in metres")
        self._visibility.check()


def check_pose(T_rig_cam: Array) -> None:
    """Raise RigError unless T_rig_cam is a proper rigid motion."""
    T = np.asarray(T_rig_cam)
    if T.shape != (4, 4) or not np.all(np.isfinite(T)) or not np.allclose(T[3], (0.0, 0.0, 0.0, 1.0)):
        raise RigError("camera: T_rig_cam takes 4x4 finite numbers with the last row [0, 0, 0, 1]")
    try:
        se3.assert_proper_rotation(T[:3, :3], "T_rig_cam")
    except FacetcamError as error:
        raise RigError(f"camera: {error}") from error
