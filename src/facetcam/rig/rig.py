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
from facetcam.geometry import reflection, se3
from facetcam.rig.camera import Camera
from facetcam.rig.mirrors import Mirror
from facetcam.rig.tracing import NO_MIRROR, follow_chain

Array = NDArray[np.float64]

NO_VIEW = -1


@dataclass(frozen=True, eq=False)
class View:
    """One chain of mirrors, in the order in which a camera ray meets them; empty for the direct view.

    `region` (N, 2), optional, bounds the view on the sensor in pixels.
    """

    mirrors: tuple[str, ...] = ()
    region: Array | None = None


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

    Raises
    ------
    RigError
        If the pose is not a rigid motion, or a view names a mirror that is absent.
    """

    camera: Camera
    T_rig_cam: Array
    mirrors: Mapping[str, Mirror] = field(default_factory=dict)
    views: Mapping[str, View] = field(default_factory=lambda: {"front": View()})

    def __post_init__(self) -> None:
        try:
            se3.assert_proper_rotation(np.asarray(self.T_rig_cam)[:3, :3], "T_rig_cam")
        except FacetcamError as error:
            raise RigError(f"camera: {error}") from None
        if not self.views:
            raise RigError("views: a rig needs at least one view")
        for name, view in self.views.items():
            for mirror in view.mirrors:
                if mirror not in self.mirrors:
                    known = ", ".join(self.mirrors) or "none"
                    raise RigError(f"view '{name}': no mirror '{mirror}' in the rig (known: {known})")

    @classmethod
    def load(cls, path: str | Path) -> Rig:
        """Read a `rig.yaml`; see `facetcam.rig.files`."""
        from facetcam.rig.files import read_rig

        return read_rig(Path(path))

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
    def _mirror_list(self) -> list[Mirror]:
        return list(self.mirrors.values())

    def _chain(self, view: str) -> list[int]:
        order = list(self.mirrors)
        return [order.index(name) for name in self.views[view].mirrors]

    def T_rig_image(self, view: str) -> Array:
        """Pose of the virtual camera that sees the raw image: S_k ... S_1 T_rig_cam, of determinant (-1)^k."""
        reflections = [self.mirrors[name].reflection for name in self.views[view].mirrors]
        return reflection.chain(reflections) @ self.T_rig_cam

    def is_flipped(self, view: str) -> bool:
        """Tell whether the view is a mirror image on the raw frame (an odd chain)."""
        return len(self.views[view].mirrors) % 2 == 1

    def T_rig_view(self, view: str) -> Array:
        """Proper pose (4, 4) of the virtual camera; for odd chains that of the image flipped left to right."""
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
        points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        pixels, valid = self.camera.project(se3.transform(se3.inverse(self.T_rig_image(view)), points))
        reached, origins, _, onward = self._trace(view, pixels)
        clear = np.linalg.norm(points - origins, axis=1) < onward.distance
        return pixels, valid & reached & clear & self._in_region(view, pixels)

    def ray(self, view: str, pixels: ArrayLike) -> tuple[Array, Array]:
        """Rays of raw pixels (N, 2) seen through one view.

        Returns
        -------
        origins : (N, 3) array
            The view's virtual centre, repeated.
        directions : (N, 3) array
            Unit directions in the rig frame.
        """
        T = self.T_rig_image(view)
        directions = self.camera.ray(pixels) @ T[:3, :3].T
        return np.broadcast_to(T[:3, 3], directions.shape).copy(), directions

    def sees(self, view: str, pixels: ArrayLike) -> NDArray[np.bool_]:
        """Tell which raw pixels (N, 2) see the room through this view's chain.

        A bounded mirror behind the chain hides the room; an unbounded one stands for a wall of unknown
        extent, before which objects are seen.
        """
        pixels = np.asarray(pixels, dtype=np.float64).reshape(-1, 2)
        reached, _, _, onward = self._trace(view, pixels)
        bounded = np.array([m.polygon is not None for m in self._mirror_list] + [False])
        blocked = (onward.mirror != NO_MIRROR) & bounded[onward.mirror]
        return reached & ~blocked & self._in_region(view, pixels)

    def labels(self) -> NDArray[np.int8]:
        """Index of the view of every raw pixel, (height, width); NO_VIEW where no view sees the room.

        Where several chains share a pixel (unbounded mirrors without regions) the longest one wins.
        """
        return self._labels.copy()

    def mask(self, margin: float = 0.0) -> NDArray[np.uint8]:
        """Valid raw pixels as 255, (height, width): further than `margin` pixels from seams and the border."""
        inside = np.zeros(self._labels.shape, dtype=np.uint8)
        for index in range(len(self.views)):
            # The padding makes the frame's edge count as a seam.
            area = np.pad((self._labels == index).astype(np.uint8), 1)
            distance = cv2.distanceTransform(area, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1]
            inside[distance > margin] = 255
        return inside

    @cached_property
    def _labels(self) -> NDArray[np.int8]:
        width, height = self.size
        grid = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(-1, 2)
        labels = np.full(len(grid), NO_VIEW, dtype=np.int8)
        by_length = sorted(range(len(self.views)), key=lambda i: len(self.views[self.view_names[i]].mirrors))
        for index in by_length:
            labels[self.sees(self.view_names[index], grid)] = index
        return labels.reshape(height, width)

    def _trace(self, view: str, pixels: Array):  # type: ignore
        directions = self.camera.ray(pixels) @ self.T_rig_cam[:3, :3].T
        origins = np.broadcast_to(self.T_rig_cam[:3, 3], directions.shape)
        return follow_chain(self._mirror_list, self._chain(view), origins, directions)

    def _in_region(self, view: str, pixels: Array) -> NDArray[np.bool_]:
        region = self.views[view].region
        if region is None:
            return np.ones(len(pixels), dtype=bool)
        contour = region.astype(np.float32).reshape(-1, 1, 2)
        return np.array([cv2.pointPolygonTest(contour, (float(u), float(v)), False) >= 0 for u, v in pixels])
