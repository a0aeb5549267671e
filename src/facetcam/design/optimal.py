"""The camera that makes the most of its sensor: the longest lens that still shows the first mirrors."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import NonlinearConstraint, minimize
from scipy.spatial.transform import Rotation

from facetcam.errors import RigError
from facetcam.geometry import se3
from facetcam.geometry.reflection import chain
from facetcam.rig import Camera, Rig

Array = NDArray[np.float64]

_EDGE_POINTS = 8  # samples a polygon edge, which a lens with distortion bends
_UNIT = 1000.0  # pixels of the focal length at which a lens is probed
_FIELD = 16384  # pixels a side of the sensor behind the probe


@dataclass(frozen=True, slots=True)
class OptimalCamera:
    """Longest focal length (pixels) and the pose (4, 4) that allows it, in the frame of the target."""

    focal: float
    T_rig_cam: Array

    def turned_from(self, T_rig_cam: Array) -> float:
        """Radians between the optical axis and that of another pose."""
        return float(math.acos(np.clip(self.T_rig_cam[:3, 2] @ T_rig_cam[:3, 2], -1.0, 1.0)))


def longest_focal(camera: Camera, points_cam: Array) -> float:
    """Longest fx, in pixels, that keeps points (N, 3) of the camera frame on the sensor.

    With lens coordinates (x, y) of a point at fx = fy = 1 and the principal point amid the sensor, fx is the
    smallest of W / 2|x| and H / 2|y|: for a rectangle seen squarely, f = W * distance / width. The
    principal point, the ratio fy / fx and the distortion are the camera's.

    Raises
    ------
    RigError
        If a point lies behind the lens or outside its field.
    """
    flat, valid = _lens_plane(camera, points_cam)
    if not valid.all():
        raise RigError("optimal camera: the first mirror reaches behind the lens or out of its field")
    room = np.array([[camera.cx + 0.5, camera.width - 0.5 - camera.cx],
                     [camera.cy + 0.5, camera.height - 0.5 - camera.cy]])  # fmt: skip
    reach = np.abs(flat) * (1.0, camera.fy / camera.fx)
    allowed = np.where(flat < 0, room[:, 0], room[:, 1]) / np.maximum(reach, 1e-12)
    return float(allowed.min())


def on_axis_focal(width: float, length: float, distance: float, size: tuple[int, int]) -> float:
    """The closed form: a rectangle (m) seen squarely from `distance`, sensor `size` in pixels."""
    return min(size[0] * distance / width, size[1] * distance / length)


def best_camera(
    camera: Camera, polygon: ArrayLike, start: Array, box: tuple[ArrayLike, ArrayLike] | None = None
) -> OptimalCamera:
    """Find the orientation, and the position within a box, that allow the longest focal length.

    Parameters
    ----------
    camera : Camera
        Sensor size, principal point and lens; its focal length is free.
    polygon : (N, 3) array
        Corners of what must stay on the sensor.
    start : (4, 4) array
        Pose to start from; without `box` its position is kept.
    box : two (3,) arrays, optional
        Least and largest position.

    Returns
    -------
    OptimalCamera
        A local optimum from several starts; never worse than `start`.
    """
    points = _along_edges(np.asarray(polygon, dtype=np.float64))
    low, high = (np.asarray(end, dtype=np.float64) for end in (box or (start[:3, 3], start[:3, 3])))
    poses = [_refine(camera, points, pose, low, high) for pose in _starts(start, points, low, high)]
    return max(poses, key=lambda found: found.focal)


def first_mirror(rig: Rig) -> Array:
    """Corners (N, 3) of the mirrors that camera rays meet first."""
    names = {view.mirrors[0] for view in rig.views.values() if view.mirrors}
    polygons = [rig.mirrors[name].polygon for name in sorted(names)]
    bounded = [polygon for polygon in polygons if polygon is not None]
    if not bounded:
        raise RigError("optimal camera: the rig has no bounded mirror that the camera looks at first")
    return np.vstack(bounded)


def unfolded_ends(rig: Rig) -> Array:
    """Corners (N, 3) of all last mirrors, where the camera sees them through the mirrors before them."""
    found = []
    for view in rig.views.values():
        if len(view.mirrors) > 1 and (polygon := rig.mirrors[view.mirrors[-1]].polygon) is not None:
            before = chain([rig.mirrors[name].reflection for name in view.mirrors[:-1]])
            found.append(se3.transform(se3.inverse(before), polygon))
    return np.vstack(found) if found else np.empty((0, 3))


def _starts(start: Array, points: Array, low: Array, high: Array) -> list[Array]:
    """The given pose, and cameras at the ends of the box that look at the middle, also on their side."""
    middle = points.mean(axis=0)
    poses = [start.copy()]
    poses[0][:3, 3] = np.clip(start[:3, 3], low, high)
    for position in {
        tuple(p.tolist()) for p in (np.clip(start[:3, 3], low, high), low, high, (low + high) / 2)
    }:
        forward = middle - position
        if np.linalg.norm(forward) < 1e-6:
            continue
        turn, _ = Rotation.align_vectors([forward / np.linalg.norm(forward)], [start[:3, 2]])
        R = turn.as_matrix() @ start[:3, :3]
        poses.append(se3.from_rotation_translation(R, position))
        quarter = Rotation.from_euler("z", 90, degrees=True).as_matrix()
        poses.append(se3.from_rotation_translation(R @ quarter, position))
    return poses


def _refine(camera: Camera, points: Array, pose: Array, low: Array, high: Array) -> OptimalCamera:
    """Raise log f under the constraint that every point stays on the sensor (SLSQP), from one pose."""
    size = np.maximum(high - low, 0.0)
    free = size > 0

    def pose_of(x: Array) -> Array:
        position = np.where(free, low + size * x[3:6], pose[:3, 3])
        return se3.from_rotation_translation(pose[:3, :3] @ Rotation.from_rotvec(x[:3]).as_matrix(), position)

    def focal_of(x: Array) -> float:
        try:
            return longest_focal(camera, se3.transform(se3.inverse(pose_of(x)), points))
        except RigError:
            return 0.0

    begin = np.zeros(6)
    begin[3:][free] = ((pose[:3, 3] - low)[free] / size[free]).clip(0, 1)
    first = focal_of(begin)
    if first == 0.0:
        return OptimalCamera(0.0, pose_of(begin))
    found = _climb(camera, points, pose_of, np.append(begin, 0.0), first, free)
    best = max((begin, found), key=focal_of)
    return OptimalCamera(focal_of(best), pose_of(best))


def _climb(
    camera: Camera, points: Array, pose_of: Callable[[Array], Array], begin: Array, first: float,
    free: NDArray[np.bool_],
) -> Array:  # fmt: skip
    half = np.array([camera.width, camera.height * camera.fx / camera.fy]) / 2
    offset = np.array(
        [camera.cx - (camera.width - 1) / 2, (camera.cy - (camera.height - 1) / 2) * camera.fx / camera.fy]
    )

    def room(x: Array) -> Array:
        """Share of the half sensor left over on each of its sides, for each point; smooth in the pose."""
        flat, valid = _lens_plane(camera, se3.transform(se3.inverse(pose_of(x[:6])), points))
        pixels = np.where(valid[:, None], first * math.exp(x[6]) * flat + offset, 1e3 * half)
        return np.concatenate([1 - pixels / half, 1 + pixels / half]).ravel()

    bounds = [(-1.5, 1.5)] * 3 + [(0.0, 1.0) if f else (0.0, 0.0) for f in free] + [(-1.0, 4.0)]

    def downhill(x: Array) -> float:
        return -float(x[6])

    def slope(x: Array) -> Array:
        down: Array = -np.eye(7)[6]
        return down

    stay = NonlinearConstraint(room, 0.0, np.inf)
    result = minimize(downhill, begin, jac=slope, method="SLSQP", bounds=bounds, constraints=stay)
    found: Array = np.where(np.isfinite(result.x), result.x, begin)[:6]
    return found


def _lens_plane(camera: Camera, points_cam: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Coordinates (N, 2) that the lens gives points at fx = fy = 1 about the principal point."""
    middle = (_FIELD - 1) / 2
    probe = replace(camera, width=_FIELD, height=_FIELD, fx=_UNIT, fy=_UNIT, cx=middle, cy=middle)
    pixels, valid = probe.project(points_cam)
    return (pixels - middle) / _UNIT, valid


def _along_edges(polygon: Array) -> Array:
    shares = np.arange(_EDGE_POINTS)[:, None] / _EDGE_POINTS
    return np.vstack([a + shares * (b - a) for a, b in zip(polygon, np.roll(polygon, -1, axis=0))])
