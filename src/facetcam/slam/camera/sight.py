"""What is seen of known points: how far it is off, and what would move it."""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from facetcam.geometry import se3
from facetcam.slam.camera.optics import Optics

Array = NDArray[np.float64]
Views = NDArray[np.integer]

_MIN_DEPTH = 0.01  # metres


class Sights(NamedTuple):
    """Points that are seen at the same time.

    A patch on an edge slides along it (the aperture problem): where on the edge it was found says little, and
    how far beside it as much as of any point. So errors and derivatives x count as (I - g g') x.

    Attributes
    ----------
    points : (N, 3) array
        World points.
    views, plane : (N,), (N, 2) arrays
        Through which views, and where on their ideal pinholes.
    edge : (N, 2) array
        The vectors g: along the images of the edges, and shorter the more points are like corners, for which
        they are zero.
    """

    points: Array
    views: Views
    plane: Array
    edge: Array

    @classmethod
    def of_corners(cls, points: Array, views: Views, plane: Array) -> Self:
        """Sights of points of which none lies on an edge."""
        return cls(points, views, plane, np.zeros((len(points), 2)))

    def on_edges(self, edges: Array, T_world_rig: Array, optics: Optics) -> Self:
        """The same of points on edges (N, 3) of the world, as long as g, seen from near a pose."""
        seen = seen_edges(T_world_rig, self.points, self.views, edges, optics)
        return self._replace(edge=seen)

    def take(self, rows: NDArray[np.bool_]) -> Sights:
        """Some of them."""
        return Sights(self.points[rows], self.views[rows], self.plane[rows], self.edge[rows])


def seen_edges(T_world_rig: Array, points: Array, views: Views, edges: Array, optics: Optics) -> Array:
    """Directions (N, 2) in the image of edges (N, 3) of the world, as long as these."""
    _, by_rig, _ = linearise_sight(T_world_rig, points, views, np.zeros((len(points), 2)), optics)
    along = np.einsum("nij,nj->ni", by_rig, edges @ T_world_rig[:3, :3])
    length = np.maximum(np.linalg.norm(along, axis=1), 1e-12)
    return np.asarray(along * (np.linalg.norm(edges, axis=1) / length)[:, None])


def across(edge: Array, values: Array) -> Array:
    """What counts of errors (N, 2), or of derivatives (N, 2, K), of sights with such edges."""
    columns = values if values.ndim == 3 else values[:, :, None]
    along = np.einsum("ni,nik->nk", edge, columns)
    return np.asarray((columns - edge[:, :, None] * along[:, None, :]).reshape(values.shape))


def coordinates(edge: Array) -> Array:
    """How many of their two coordinates sights tell, (N,): the squares of what counts, along and across."""
    return np.asarray(1.0 + (1.0 - np.sum(edge**2, axis=1)) ** 2)


def linearise(T_world_rig: Array, seen: Sights, optics: Optics) -> tuple[Array, Array]:
    """What counts of residuals (N, 2) on the pinholes, and of derivatives (N, 2, 6) by a right-hand twist.

    Both are zero for a point behind its view.
    """
    residual, J = linearise_whole(T_world_rig, seen, optics)
    return across(seen.edge, residual), across(seen.edge, J)


def linearise_whole(T_world_rig: Array, seen: Sights, optics: Optics) -> tuple[Array, Array]:
    """The same residuals and derivatives, along edges too."""
    residual, by_rig, points_rig = linearise_sight(T_world_rig, *seen[:3], optics)
    x, y, z = points_rig.T[:, :, None]
    a, b, c = np.moveaxis(by_rig, 2, 0)  # the point moves against the rig: by_rig [p]x, then -by_rig
    return residual, np.stack([b * z - c * y, c * x - a * z, a * y - b * x, -a, -b, -c], axis=2)


def linearise_sight(
    T_world_rig: Array, points: Array, views: Views, plane: Array, optics: Optics
) -> tuple[Array, Array, Array]:
    """Residuals (N, 2) of points on their pinholes, derivatives (N, 2, 3) by points in the rig, and these."""
    points_rig = se3.transform(se3.inverse(T_world_rig), points)
    predicted, depth = optics.to_plane(points_rig, views)
    in_front = depth > _MIN_DEPTH
    depth = np.where(in_front, depth, 1.0)[:, None]
    aside, ahead = optics.T_view_rig[views, :2, :3], optics.T_view_rig[views, 2, :3]
    by_rig = optics.focal / depth[:, :, None] * aside - (predicted / depth)[:, :, None] * ahead[:, None, :]
    by_rig[~in_front] = 0.0
    return np.where(in_front[:, None], predicted - plane, 0.0), by_rig, points_rig
