"""The map: keyframes with what they saw, and points."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from facetcam.geometry import se3
from facetcam.slam.camera.edges import patch_edges
from facetcam.slam.camera.frame import Corners, Frame, repeated
from facetcam.slam.camera.optics import Optics
from facetcam.slam.camera.patches import cut_patches
from facetcam.slam.map.points import Points, tangents
from facetcam.slam.threads import FairLock

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_YOUNG = 8  # keyframes
WIDE = 50  # keyframes around, for frames that show little of what the nearest ones saw


@dataclass(slots=True)
class Observations:
    """What one keyframe saw: point ids, view indices, raw pixels and ideal-pinhole positions, row by row."""

    point: Index = field(default_factory=lambda: np.empty(0, np.int64))
    view: NDArray[np.int8] = field(default_factory=lambda: np.empty(0, np.int8))
    pixels: Array = field(default_factory=lambda: np.empty((0, 2)))
    plane: Array = field(default_factory=lambda: np.empty((0, 2)))

    def __len__(self) -> int:
        return len(self.point)

    def append(self, point: Index, view: NDArray[np.int8], pixels: Array, plane: Array) -> None:
        """Add rows."""
        self.point = np.concatenate([self.point, point])
        self.view = np.concatenate([self.view, view])
        self.pixels = np.concatenate([self.pixels, pixels])
        self.plane = np.concatenate([self.plane, plane])

    def keep(self, rows: NDArray[np.bool_]) -> None:
        """Drop all rows but these."""
        self.point, self.view = self.point[rows], self.view[rows]
        self.pixels, self.plane = self.pixels[rows], self.plane[rows]

    def has(self, point: Index, view: NDArray[np.int8]) -> NDArray[np.bool_]:
        """Tell which (point, view) pairs are observed already."""
        return _are_among([self], point, view)


def _are_among(seen: list[Observations], point: Index, view: NDArray[np.int8]) -> NDArray[np.bool_]:
    """Tell which (point, view) pairs (N,) any of the observations hold."""
    points, views = np.concatenate([point, *(s.point for s in seen)]), [view, *(s.view for s in seen)]
    rows = np.concatenate(views).astype(np.intp)
    table = np.zeros((rows.max(initial=0) + 1, points.max(initial=0) + 1), dtype=bool)
    table[rows[len(point) :], points[len(point) :]] = True
    return np.asarray(table[rows[: len(point)], point])


@dataclass(frozen=True, slots=True)
class HandedOver:
    """Where points that one view, their `home`, has mapped were found in another, at whatever scale."""

    point: Index = field(default_factory=lambda: np.empty(0, np.int64))
    home: NDArray[np.int8] = field(default_factory=lambda: np.empty(0, np.int8))
    view: NDArray[np.int8] = field(default_factory=lambda: np.empty(0, np.int8))
    pixels: Array = field(default_factory=lambda: np.empty((0, 2)))

    def __len__(self) -> int:
        return len(self.point)

    def take(self, rows: NDArray[np.generic]) -> HandedOver:
        """Some of the rows."""
        return HandedOver(self.point[rows], self.home[rows], self.view[rows], self.pixels[rows])


@dataclass(slots=True)
class Keyframe:
    """A frame that stays: its pose, observations and corners; its images only while it is in the window.

    `free` marks the corners that are no map point yet.
    """

    index: int
    timestamp: float
    T_world_rig: Array
    corners: Corners
    frame: Frame | None
    odometry: Array | None
    observations: Observations = field(default_factory=Observations)
    free: NDArray[np.bool_] = field(default_factory=lambda: np.empty(0, bool))
    measured: int = 0  # points tracked when it was made
    scale: float = 1.0  # growth of the map round this keyframe by adjustments since it was made
    covariance: Array | None = None  # (6, 6) against the first keyframe, since the map was last judged
    drift: Array = field(default_factory=lambda: np.zeros((6, 6)))  # covariance, of a map not judged since
    handovers: HandedOver = field(default_factory=HandedOver)
    session: int = 0  # the run that made it; wheels and window do not reach over runs
    velocity: Array = field(default_factory=lambda: np.zeros(6))  # right-hand twist a second

    def grow(self, factor: float) -> None:
        """Note that the map round this keyframe has been scaled."""
        self.scale *= factor
        self.velocity[3:] *= factor


def shared_points(a: Keyframe, b: Keyframe) -> int:
    """Count the points that two keyframes saw."""
    seen = (a.observations.point, b.observations.point)
    by_a, by_b = np.zeros((2, max(int(ids.max(initial=-1)) for ids in seen) + 1), dtype=bool)
    by_a[seen[0]], by_b[seen[1]] = True, True
    return int(np.count_nonzero(by_a & by_b))


class Map:
    """All keyframes and points.

    Whoever holds `lock` sees a whole map; mapping takes it step by step, so that tracking waits for
    milliseconds only. `number` tells the maps of a run apart, each of which has a world of its own.
    """

    def __init__(self) -> None:
        self.lock = FairLock()
        self.number = 0
        self.clear()

    def moved_out(self) -> Map:
        """A map with all that this one holds, which is empty then."""
        other = Map()
        other.become(self)
        self.clear()
        return other

    def become(self, other: Map) -> None:
        """Hold what another one does."""
        for name in ("number", "points", "keyframes", "since", "readout", "creep"):
            setattr(self, name, getattr(other, name))

    def clear(self) -> None:
        """Forget everything."""
        self.points = Points()
        self.keyframes: list[Keyframe] = []
        self.since = 0  # keyframe with which the map went on after a gap that no sight has crossed
        self.readout = 0.0  # seconds from the first row of a frame to the last, as estimated
        self.creep = np.zeros(2)  # px (x, y) by which the image lies off the rig's file, as estimated

    @property
    def young(self) -> bool:
        """True while a map that fails is rather wrong, and given up."""
        return len(self.keyframes) < _YOUNG

    def poses(self) -> Array:
        """Poses (K, 4, 4) of the keyframes."""
        return np.array([k.T_world_rig for k in self.keyframes]).reshape(-1, 4, 4)

    def see_through(self, optics: Optics) -> None:
        """See through a rig that has changed or crept: what was seen lies elsewhere on its ideal pinholes."""
        optics.creep_to(self.creep)
        for keyframe in self.keyframes:
            seen, corners = keyframe.observations, keyframe.corners
            seen.plane = optics.plane(seen.pixels, seen.view)
            keyframe.corners = replace(corners, plane=optics.plane(corners.pixels, corners.views))

    def observed_points(self, keyframes: list[Keyframe]) -> Index:
        """Ids of living points that any of these keyframes saw."""
        seen = np.zeros(len(self.points), dtype=bool)
        for keyframe in keyframes:
            seen[keyframe.observations.point] = True
        return np.flatnonzero(seen & self.points.alive)

    def drop_unproven(self, left: list[Keyframe], kept: list[Keyframe]) -> None:
        """Drop what some keyframes saw, none of those kept did, and tracking has never found again.

        Corners that look alike are many among these points, and fit the pose at which they met (compare the
        test of recent points in R. Mur-Artal, J. M. M. Montiel, J. D. Tardos, "ORB-SLAM", 2015).
        """
        ids = np.setdiff1d(self.observed_points(left), self.observed_points(kept))
        self.points.alive[ids[self.points.found[ids] == 0]] = False

    def unmistakable(
        self, point: Index, view: NDArray[np.int8], keyframes: list[Keyframe]
    ) -> NDArray[np.bool_]:
        """Tell which points (N,) may be sought in which views (N,): what repeats only where it was seen.

        Once a map is bent, patches near a prediction find the neighbour of what repeats, and bend it for
        good. In a view in which one of the keyframes saw it, it is followed all the same.
        """
        shown = _are_among([k.observations for k in keyframes], point, view)
        return np.asarray(shown | ~self.points.repeated[point])

    def covisible(self, points: Index, keyframes: list[Keyframe]) -> list[Keyframe]:
        """Those of the keyframes that saw any of these points, the one that saw most of them first."""
        wanted = np.zeros(len(self.points), dtype=bool)
        wanted[points] = True
        shared = np.array([np.count_nonzero(wanted[k.observations.point]) for k in keyframes])
        order = np.argsort(-shared, kind="stable")
        return [keyframes[i] for i in order if shared[i]]

    def near(self, position: Array, count: int) -> list[Keyframe]:
        """The keyframes whose rig stood nearest to a world position."""
        if not self.keyframes:
            return []
        centres = np.array([k.T_world_rig[:3, 3] for k in self.keyframes])
        order = np.argsort(np.linalg.norm(centres - position, axis=1), kind="stable")
        return [self.keyframes[i] for i in order[:count]]

    def points_around(self, position: Array) -> Index:
        """Ids of living points that the keyframes around a world position saw."""
        return self.observed_points(self.near(position, WIDE))

    def add_points(
        self, xyz: Array, keyframe: Keyframe, corner: Index, optics: Optics
    ) -> tuple[Index, NDArray[np.bool_]]:
        """Make points that look as the keyframe's corners do.

        Returns
        -------
        ids : (M,) array
        kept : (N,) bool array
            False where the patch would reach over the border of the frame.
        """
        assert keyframe.frame is not None and keyframe.frame.colours is not None
        pixels, views = keyframe.corners.pixels[corner], keyframe.corners.views[corner]
        patches, offsets, kept = cut_patches(keyframe.frame.grey, pixels)
        T_rig_world = se3.inverse(keyframe.T_world_rig)
        points_rig = se3.transform(T_rig_world, xyz)
        tangent = tangents(points_rig, views, optics)
        jacobian = optics.jacobians(views, points_rig, tangent)
        kept &= np.abs(np.linalg.det(jacobian)) > 1e-6
        ids = self.points.extend(
            xyz=xyz[kept],
            patch=patches[kept],
            offset=offsets[kept],
            tangent=(keyframe.T_world_rig[:3, :3] @ tangent)[kept],
            jacobian=jacobian[kept],
            edge=patch_edges(patches[kept], offsets[kept], jacobian[kept]),
            descriptor=keyframe.corners.descriptors[corner[kept]],
            colour=keyframe.frame.colours[corner[kept]],
            repeated=repeated(keyframe.corners, corner[kept]),
        )
        return ids, kept
