"""The rig as tracking sees it: a generalised camera of ideal pinholes, one a view."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from facetcam.geometry import se3
from facetcam.rig import NO_VIEW, Camera, Rig
from facetcam.rig.camera import KANNALA_BRANDT

Array = NDArray[np.float64]
Index = NDArray[np.integer]

_SAMPLES = 400
_LEAST_UP = 0.3  # sine of the angle between a ray and up, below which up has no clear direction
_DISTANCES = (10.0, 40.0, 160.0)  # of the farthest view from the middle of all
_LEAST_SHARED = 0.02  # of a view's pixels
_STEEPEST = np.cos(np.radians(75.0))  # an ideal pinhole stretches pixels without bound beyond


class Optics:
    """Projection, rays and valid pixels of all views at once.

    Each view gets an ideal pinhole at its virtual centre that looks along the view's mean ray, so that
    solvers meet neither distortion nor mirrors.

    Parameters
    ----------
    rig : Rig
    margin : float
        Pixels to stay away from seams and the border of the frame.

    Attributes
    ----------
    n_views : int
    focal : float
        Focal length of the ideal pinholes, in pixels.
    T_view_rig : (V, 4, 4) array
        Rig frame to ideal pinhole, proper.
    samples : list of (N, 2) arrays
        Some raw pixels of each view.
    overlapping : list of (int, int)
        Views that see the same part of the world at once.
    """

    def __init__(self, rig: Rig, margin: float) -> None:
        self.names = rig.view_names
        self.n_views = len(self.names)
        self.mask = rig.mask(margin)
        self.labels = np.where(self.mask > 0, rig.labels(), NO_VIEW).astype(np.int8)
        self.flipped = np.array([rig.is_flipped(name) for name in self.names])
        self.samples = [self._sample(v, rig) for v in range(self.n_views)]
        self.take_up(rig)
        self.overlapping = self._overlapping()
        if rig.camera.model == KANNALA_BRANDT:
            self._leave_out_steep_rays()

    def take_up(self, rig: Rig) -> None:
        """Go over to a rig that is hardly another one: its numbers moved, but its valid pixels stay."""
        self.rig = self._given = rig
        self.focal = float(np.sqrt(rig.camera.fx * rig.camera.fy))
        self._T_image_rig = np.stack([se3.inverse(rig.T_rig_image(name)) for name in self.names])
        self.T_view_rig = np.stack([self._ideal_pose(v) for v in range(self.n_views)])
        self.T_rig_view = se3.inverse(self.T_view_rig)
        self._up = np.stack([_up_axis(T[2, :3]) for T in self.T_view_rig])
        self.roll_degrees = np.array([self._roll(v) for v in range(self.n_views)])

    def creep_to(self, creep: Array) -> None:
        """Let the image be shifted by so many pixels (x, y) against the rig that was given or taken up."""
        x, y = creep.tolist()
        camera = replace(self._given.camera, cx=self._given.camera.cx + x, cy=self._given.camera.cy + y)
        self.rig = replace(self._given, camera=camera)

    def adapted(self, rig: Rig) -> Optics:
        """The same for a rig that is hardly another one (`take_up`)."""
        other = copy.copy(self)
        other.take_up(rig)
        return other

    @property
    def camera(self) -> Camera:
        """The real camera."""
        return self.rig.camera

    def _sample(self, view: int, rig: Rig) -> Array:
        """Some raw pixels (N, 2) of a view."""
        rows, columns = np.nonzero(self.labels == view)
        if not len(rows):
            rows, columns = np.nonzero(rig.labels() == view)
        pick = np.linspace(0, len(rows) - 1, min(_SAMPLES, len(rows))).astype(int)
        return np.column_stack([columns[pick], rows[pick]])

    def _ideal_pose(self, view: int) -> Array:
        """Pose of the pinhole along the mean ray of a view, upright in the rig where that is defined."""
        origins, rays = self.rig.ray(self.names[view], self.samples[view])
        z = rays.mean(axis=0) / np.linalg.norm(rays.mean(axis=0))
        x = np.cross(z, _up_axis(z))
        x /= np.linalg.norm(x)
        return se3.inverse(se3.from_rotation_translation(np.column_stack([x, np.cross(z, x), z]), origins[0]))

    def _leave_out_steep_rays(self) -> None:
        """Drop the pixels of a wide lens that an ideal pinhole cannot hold."""
        rows, columns = np.nonzero(self.labels != NO_VIEW)
        views = self.labels[rows, columns]
        rays = self.rays(np.column_stack([columns, rows]), views)
        steep = np.einsum("ni,ni->n", rays, self.T_view_rig[views, 2, :3]) < _STEEPEST
        self.labels[rows[steep], columns[steep]] = NO_VIEW
        self.mask[rows[steep], columns[steep]] = 0

    def _overlapping(self) -> list[tuple[int, int]]:
        """Pairs of views of which one sees what lies on the other's rays, at some distance."""
        if self.n_views < 2:
            return []
        centres = self.T_rig_view[:, :3, 3]
        baseline = float(np.linalg.norm(centres - centres.mean(axis=0), axis=1).max())
        shared = np.zeros((self.n_views, self.n_views), dtype=bool)
        for view, pixels in enumerate(self.samples):
            views = np.full(len(pixels), view)
            rays, origins = self.rays(pixels, views), self.origins(views)
            for distance in _DISTANCES:
                seen = self.project(origins + distance * baseline * rays)[1]
                shared[view] |= seen.mean(axis=1) > _LEAST_SHARED
        return [(v, w) for v in range(self.n_views) for w in range(v + 1, self.n_views) if shared[v, w]]

    def _roll(self, view: int) -> float:
        """Angle on the raw frame, in degrees, of the pinhole's x axis."""
        across = self.T_rig_view[view, :3, :2]
        centre = self.T_rig_view[view, :3, 3] + self.T_rig_view[view, :3, 2]
        x = self.jacobians(np.array([view]), centre[None], 1e-3 * across[None])[0, :, 0]
        return float(np.degrees(np.arctan2(x[1], x[0])))

    def upright_degrees(self, pixels: Array, views: Index) -> Array:
        """Angles (N,) on the raw frame, in degrees, by which pixels' surroundings are turned from upright.

        Upright means along the rig's up axis at this very ray, so a thing looks alike wherever in whichever
        view it is seen. Rays along that axis take the roll of their view.
        """
        rays, origins = self.rays(pixels, views), self.origins(views)
        up = self._up[views] - np.sum(self._up[views] * rays, axis=1, keepdims=True) * rays
        seen = self.jacobians(views, origins + rays, np.repeat(1e-3 * up[:, :, None], 2, axis=2))[:, :, 0]
        angle = np.degrees(np.arctan2(seen[:, 1], seen[:, 0])) + np.where(self.flipped[views], -90.0, 90.0)
        along = np.linalg.norm(up, axis=1) < _LEAST_UP
        return np.mod(np.where(along, self.roll_degrees[views], angle), 360.0)

    def view_of(self, pixels: Array) -> NDArray[np.int8]:
        """View index of raw pixels (N, 2); NO_VIEW off the frame, on seams and on dead pixels."""
        columns, rows = np.rint(pixels).astype(np.int64).T
        height, width = self.labels.shape
        inside = (columns >= 0) & (rows >= 0) & (columns < width) & (rows < height)
        labels = self.labels[np.where(inside, rows, 0), np.where(inside, columns, 0)]
        return np.where(inside, labels, NO_VIEW).astype(np.int8)

    def project(self, points_rig: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Raw pixels (V, N, 2) of points in every view, and whether they land on its valid pixels."""
        T = self._T_image_rig
        local = points_rig @ np.swapaxes(T[:, :3, :3], 1, 2) + T[:, None, :3, 3]
        pixels, valid = self.camera.project(local)
        rows = np.flatnonzero(valid)
        valid[rows] = self.view_of(pixels[rows]) == rows // max(len(points_rig), 1)
        return pixels.reshape((*local.shape[:2], 2)), valid.reshape(local.shape[:2])

    def jacobians(self, views: Index, points_rig: Array, step: Array) -> Array:
        """Change of the raw pixels, (N, 2, 2), along two steps (N, 3, 2) of points in their views."""
        T = self._T_image_rig[views]
        points = _rotated(T[:, :3, :3], points_rig) + T[:, :3, 3]
        steps = np.moveaxis(T[:, :3, :3] @ step, 2, 0)
        pixels, _ = self.camera.project(np.stack([points + steps, points - steps]))
        ahead, behind = pixels.reshape(2, 2, -1, 2)
        return np.moveaxis(ahead - behind, 0, 2) / 2.0

    def rays(self, pixels: Array, views: Index) -> Array:
        """Unit directions (N, 3) in the rig frame of raw pixels seen through their views."""
        rotation = np.swapaxes(self._T_image_rig[views, :3, :3], 1, 2)
        return _rotated(rotation, self.camera.ray(pixels))

    def origins(self, views: Index) -> Array:
        """Virtual centres (N, 3) of views in the rig frame."""
        return self.T_rig_view[views, :3, 3]

    def plane(self, pixels: Array, views: Index) -> Array:
        """Where raw pixels fall on their view's ideal pinhole, (N, 2) in pixels from its principal point."""
        rays = _rotated(self.T_view_rig[views, :3, :3], self.rays(pixels, views))
        # Measurements lie up to half a pixel beyond the last pixel that is not too steep.
        return np.asarray(self.focal * rays[:, :2] / np.maximum(rays[:, 2:], 0.5 * _STEEPEST))

    def plane_rays(self, plane: Array, views: Index) -> Array:
        """Unit directions (N, 3) in the rig frame of positions on the ideal pinholes."""
        local = np.column_stack([plane / self.focal, np.ones(len(plane))])
        local /= np.linalg.norm(local, axis=1, keepdims=True)
        return _rotated(self.T_rig_view[views, :3, :3], local)

    def pixels(self, plane: Array, views: Index) -> Array:
        """Raw pixels (N, 2) of positions on the ideal pinholes: the inverse of `plane`."""
        rays = _rotated(self._T_image_rig[views, :3, :3], self.plane_rays(plane, views))
        return self.camera.project(rays)[0]

    def to_plane(self, points_rig: Array, views: Index) -> tuple[Array, Array]:
        """Points (N, 3) on the ideal pinholes of their views: plane coordinates (N, 2) and depths (N,)."""
        T = self.T_view_rig[views]
        local = _rotated(T[:, :3, :3], points_rig) + T[:, :3, 3]
        depth = local[:, 2]
        return self.focal * local[:, :2] / np.where(np.abs(depth) < 1e-9, 1e-9, depth)[:, None], depth


def _up_axis(z: Array) -> Array:
    """Up of the rig, or its front where a view looks along up."""
    return np.array([0.0, 0.0, 1.0]) if abs(z[2]) < 0.95 else np.array([0.0, 1.0, 0.0])


def _rotated(rotations: Array, vectors: Array) -> Array:
    """Each vector (N, 3) turned by its own rotation (N, 3, 3)."""
    return (rotations @ vectors[:, :, None])[:, :, 0]
