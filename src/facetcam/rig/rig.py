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
from facetcam.rig.tracing import Paths, Tracer

Array = NDArray[np.float64]

NO_VIEW = -1

_BAND = 128  # rows traced at once, so that memory stays small


def inside_polygon(polygon: Array, points: Array) -> NDArray[np.bool_]:
    """Tell which points (N, 2) lie inside a simple polygon (M, 2), by counting crossings to the right."""
    inside = np.zeros(len(points), dtype=bool)
    x, y = points.T
    for (x0, y0), (x1, y1) in zip(polygon, np.roll(polygon, -1, axis=0)):
        spans = (y0 <= y) != (y1 <= y)
        if y0 != y1:
            inside ^= spans & (x < x0 + (y - y0) * (x1 - x0) / (y1 - y0))
    return inside


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
    def _tracer(self) -> Tracer:
        return Tracer(list(self.mirrors.values()), self.T_rig_cam)

    @cached_property
    def _chains(self) -> dict[str, list[int]]:
        """Mirror indices of each view's chain."""
        order = list(self.mirrors)
        return {name: [order.index(mirror) for mirror in view.mirrors] for name, view in self.views.items()}

    def T_rig_image(self, view: str) -> Array:
        """Pose of the virtual camera of the raw image: S_k ... S_1 T_rig_cam, of determinant (-1)^k."""
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
        in_camera = se3.transform(se3.inverse(self.T_rig_image(view)), np.reshape(points, (-1, 3)))
        pixels, valid = self.camera.project(in_camera)
        distance = np.linalg.norm(in_camera, axis=1)
        chain = self._chains[view]
        paths = self._tracer.trace(in_camera / np.maximum(distance, 1e-12)[:, None], len(chain) + 1)
        beyond_chain = distance > paths.length[len(chain) - 1] if chain else True
        clear = paths.met(chain) & beyond_chain & (distance < paths.length[len(chain)])
        return pixels, valid & clear & self._in_region(view, pixels)

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
        paths = self._tracer.trace(self.camera.ray(pixels), len(self._chains[view]) + 1)
        return self._seen_on(view, paths, pixels)

    def labels(self) -> NDArray[np.int8]:
        """Index of the view of every raw pixel, (height, width); NO_VIEW where no view sees the room.

        Where several chains share a pixel (unbounded mirrors without regions) the longest one wins.
        """
        return self._labels.copy()

    def mask(self, margin: float = 0.0) -> NDArray[np.uint8]:
        """Valid raw pixels as 255, (height, width): more than `margin` pixels from seams and the border."""
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
        by_length = sorted(self.views, key=lambda name: len(self._chains[name]))
        bounces = len(self._chains[by_length[-1]]) + 1
        labels = np.full((height, width), NO_VIEW, dtype=np.int8)
        for top in range(0, height, _BAND):
            band = labels[top : top + _BAND]
            v, u = np.indices(band.shape, dtype=np.float64)
            pixels = np.stack([u.ravel(), v.ravel() + top], axis=1)
            paths = self._tracer.trace(self.camera.ray(pixels), bounces)
            for name in by_length:
                band[self._seen_on(name, paths, pixels).reshape(band.shape)] = self.view_names.index(name)
        return labels

    def _seen_on(self, view: str, paths: Paths, pixels: Array) -> NDArray[np.bool_]:
        chain = self._chains[view]
        # Negative indices reach the last two entries: NOWHERE, then LEAVES.
        passable = np.array([m.polygon is None for m in self.mirrors.values()] + [False, True])
        seen: NDArray[np.bool_] = paths.met(chain) & passable[paths.mirror[len(chain)]]
        return seen & self._in_region(view, pixels)

    def _in_region(self, view: str, pixels: Array) -> NDArray[np.bool_]:
        region = self.views[view].region
        return np.ones(len(pixels), dtype=bool) if region is None else inside_polygon(region, pixels)
