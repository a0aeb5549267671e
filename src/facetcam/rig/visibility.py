"""Which pixel sees the room through which chain of mirrors."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from facetcam.errors import RigError
from facetcam.geometry.glass import displacement, slant
from facetcam.rig.camera import Camera
from facetcam.rig.mirrors import Mirror
from facetcam.rig.tracing import NOWHERE, Paths, Tracer
from facetcam.rig.view import View

Array = NDArray[np.float64]

NO_VIEW = -1

_BAND = 128  # rows traced at once, so that memory stays small
_COARSE = 64  # rows or columns of the grid on which views are looked for first


@dataclass(frozen=True, eq=False)
class Visibility:
    """Tracing of a rig's camera rays, read as views.

    Parameters are those of `Rig`.
    """

    camera: Camera
    T_rig_cam: Array
    mirrors: Mapping[str, Mirror]
    views: Mapping[str, View]

    @cached_property
    def _tracer(self) -> Tracer:
        return Tracer(list(self.mirrors.values()), self.T_rig_cam)

    @cached_property
    def _chains(self) -> dict[str, list[int]]:
        """Mirror indices of each view's chain."""
        order = list(self.mirrors)
        return {name: [order.index(mirror) for mirror in view.mirrors] for name, view in self.views.items()}

    @cached_property
    def _glass(self) -> dict[str, tuple[Array, Array] | None]:
        return {name: self._panes(view.mirrors) for name, view in self.views.items()}

    def glass(self, view: str) -> tuple[Array, Array] | None:
        """Unfolded normals (M, 3) in the camera frame, and thickness and index (M, 2), of the glass mirrors
        of the view's chain: what `geometry.glass` takes. None without glass."""
        return self._glass[view]

    def _panes(self, chain: Iterable[str]) -> tuple[Array, Array] | None:
        turn, normals, panes = self.T_rig_cam[:3, :3], [], []
        for mirror in map(self.mirrors.__getitem__, chain):
            if mirror.glass is not None and mirror.glass.thickness > 0:
                normals.append(turn.T @ mirror.normal)
                panes.append((mirror.glass.thickness, mirror.glass.index))
            turn = mirror.reflection[:3, :3] @ turn
        return (np.array(normals), np.array(panes)) if panes else None

    def middle_displacement(self, view: str) -> Array:
        """Displacement (3,) of the view's middle ray by its glass, camera frame."""
        return self._middle_displacements[view]

    @cached_property
    def _middle_displacements(self) -> dict[str, Array]:
        pixels = self._coarse_pixels()
        labels, offsets = self.label(pixels), {}
        for index, view in enumerate(self.views):
            panes, own = self.glass(view), pixels[labels == index]
            if panes is not None:
                middle = self.camera.ray(own if len(own) else pixels).mean(axis=0)
                offsets[view] = displacement((middle / np.linalg.norm(middle))[None], *panes)[0]
        return offsets

    def reaches(self, view: str, points_cam: Array) -> NDArray[np.bool_]:
        """Tell which points (N, 3), in the frame of the view's raw image, light joins with the camera.

        Reflection keeps lengths: the point lies beyond the last mirror of the chain and before anything
        else exactly when its distance does. Points behind glass come straightened (`geometry.glass`).
        """
        chain = self._chains[view]
        distance = np.linalg.norm(points_cam, axis=1)
        directions = points_cam / np.maximum(distance, 1e-12)[:, None]
        paths = self._tracer.trace(directions, len(chain) + 1)
        reached: NDArray[np.bool_] = paths.met(chain) & (distance < paths.length[len(chain)])
        if chain:
            reached &= distance > paths.length[len(chain) - 1] + self._last_slant(view, directions)
        return reached

    def _last_slant(self, view: str, directions: Array) -> Array | float:
        """Length that the glass of the chain's last mirror adds to the path, behind the bounce."""
        last = self.mirrors[self.views[view].mirrors[-1]].glass
        panes = self.glass(view)
        if last is None or panes is None:
            return 0.0
        return slant(directions @ panes[0][-1], last.thickness, last.index)

    def sees(self, view: str, pixels: Array) -> NDArray[np.bool_]:
        """Tell which raw pixels (N, 2) see the room through the view's chain; see `Rig.sees`."""
        return self._seen_on(view, self._trace(pixels, len(self._chains[view])), pixels)

    def label(self, pixels: Array) -> NDArray[np.int8]:
        """Index of the view of each raw pixel (N, 2), the longest chain where several see, else NO_VIEW."""
        shortest_first = sorted(self.views, key=lambda name: len(self._chains[name]))
        paths = self._trace(pixels, len(self._chains[shortest_first[-1]]))
        labels = np.full(len(pixels), NO_VIEW, dtype=np.int8)
        for name in shortest_first:
            labels[self._seen_on(name, paths, pixels)] = list(self.views).index(name)
        return labels

    @cached_property
    def label_map(self) -> NDArray[np.int8]:
        """`label` of every pixel of the raw frame, (height, width)."""
        labels = np.empty((self.camera.height, self.camera.width), dtype=np.int8)
        for top in range(0, len(labels), _BAND):
            band = labels[top : top + _BAND]
            v, u = np.indices(band.shape, dtype=np.float64)
            band[:] = self.label(np.stack([u.ravel(), v.ravel() + top], axis=1)).reshape(band.shape)
        return labels

    def check(self) -> None:
        """Raise RigError if no pixel of the raw frame is a view's own."""
        empty = set(range(len(self.views))) - set(self.label(self._coarse_pixels()).tolist())
        if empty:
            empty -= set(np.unique(self.label_map).tolist())
        if empty:
            name = list(self.views)[min(empty)]
            raise RigError(f"view '{name}': no pixel sees the room through it; {self._why_blind(name)}")

    def _trace(self, pixels: Array, mirrors: int) -> Paths:
        """Paths over `mirrors` bounces and the one after, which tells what hides the room."""
        return self._tracer.trace(self.camera.ray(pixels), mirrors + 1)

    def _seen_on(self, view: str, paths: Paths, pixels: Array) -> NDArray[np.bool_]:
        chain = self._chains[view]
        # Negative indices reach the last two entries: NOWHERE, then LEAVES.
        passable = np.array([mirror.polygon is None for mirror in self.mirrors.values()] + [False, True])
        seen: NDArray[np.bool_] = paths.met(chain) & passable[paths.mirror[len(chain)]]
        return seen & self.views[view].covers(pixels)

    def _coarse_pixels(self) -> Array:
        step = max(1, min(self.camera.width, self.camera.height) // _COARSE)
        v, u = np.mgrid[0 : self.camera.height : step, 0 : self.camera.width : step]
        return np.stack([u.ravel(), v.ravel()], axis=1).astype(np.float64)

    def _why_blind(self, view: str) -> str:
        pixels = self._coarse_pixels()
        chain, names = self._chains[view], self.views[view].mirrors
        paths = self._trace(pixels, len(chain))
        if np.all(paths.mirror[0] == NOWHERE):
            return "the lens distortion gives no pixel a ray, check its coefficients"
        for count in range(1, len(chain) + 1):
            if not paths.met(chain[:count]).any():
                sender = "the camera" if count == 1 else f"mirror '{names[count - 2]}'"
                return f"{sender} stands behind mirror '{names[count - 1]}' or its rays pass it by"
        if not self._seen_on(view, paths, pixels).any():
            return "another mirror stands before the room, or its region lies elsewhere"
        return "other views take all its pixels, give the views regions or the mirrors polygons"
