"""How far two rigs differ where it counts: in where they see points of the room."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from facetcam.calibration import lens
from facetcam.calibration.optics import MirrorOptics
from facetcam.errors import FacetcamError
from facetcam.geometry import se3
from facetcam.rig import Rig

Array = NDArray[np.float64]

NEAREST, FARTHEST = 0.5, 6.0  # metres
_ROUNDS = 6


@dataclass(frozen=True, eq=False)
class Difference:
    """Distances between two projections of the same points.

    Attributes
    ----------
    rms : float
        Pixels, over all points.
    by_view : mapping of view to float
    T_b_a : (4, 4) array
        The alignment of the rig frames that was taken out.
    """

    rms: float
    by_view: Mapping[str, float]
    T_b_a: Array


def room_points(
    rig: Rig, views: Sequence[str], count: int, seed: int = 0, span: tuple[float, float] = (NEAREST, FARTHEST)
) -> dict[str, Array]:
    """Random points (count, 3) of the rig frame that each view shows: pixels and depths drawn evenly."""
    random = np.random.default_rng(seed)
    labels = rig.labels()
    points = {}
    for view in views:
        v, u = np.nonzero(labels == rig.view_names.index(view))
        if len(u) == 0:
            raise FacetcamError(f"view '{view}': no pixel sees the room through it; check the rig")
        chosen = random.integers(0, len(u), count)
        pixels = np.stack([u, v], axis=1)[chosen] + random.uniform(-0.5, 0.5, (count, 2))
        origins, directions = rig.ray(view, pixels)
        points[view] = origins + directions * random.uniform(*span, count)[:, None]
    return points


def projection_difference(a: Rig, b: Rig, points: Mapping[str, Array], align: bool = True) -> Difference:
    """Compare where two rigs see points, after the best rigid alignment of their frames.

    Parameters
    ----------
    a, b : Rig
        Both with the views named in `points`.
    points : mapping of view to (N, 3) array
        In the frame of `a`; see `room_points`.
    align : bool
        Whether the frame of `b` may be moved: where a rig's frame lies in its mirrors is a matter of choice.
    """
    views = list(points)
    lens_a, lens_b = Seen.of(a, views), Seen.of(b, views)
    wanted = {v: lens_a.pixels(v, points[v]) for v in views}
    # The cameras are one and the same: rigs found without a drawing have frames far from the drawing's.
    T = b.T_rig_cam @ se3.inverse(a.T_rig_cam) if align else np.eye(4)
    for _ in range(_ROUNDS if align else 0):
        H, g = np.zeros((6, 6)), np.zeros(6)
        for v in views:
            moved = se3.transform(T, points[v])
            pixels, by_points = lens_b.pixels_with_derivatives(v, moved)
            J = np.concatenate([by_points @ -se3.skew(moved), by_points], axis=2).reshape(-1, 6)
            H += J.T @ J
            g += J.T @ (wanted[v] - pixels).reshape(-1)
        T = se3.exp(np.linalg.solve(H, g)) @ T
    squares = {
        v: np.sum((wanted[v] - lens_b.pixels(v, se3.transform(T, points[v]))) ** 2, axis=1) for v in views
    }
    by_view = {v: float(np.sqrt(s.mean())) for v, s in squares.items()}
    return Difference(float(np.sqrt(np.concatenate(list(squares.values())).mean())), by_view, T)


@dataclass(frozen=True, eq=False)
class Seen:
    """Where a rig sees points, the sensor and the mirrors unbounded."""

    model: str
    intrinsics: Array
    optics: MirrorOptics
    views: tuple[str, ...]

    @classmethod
    def of(cls, rig: Rig, views: Sequence[str]) -> Seen:
        """Of some views of a rig."""
        optics = MirrorOptics.of(rig, views, 1.0, 1.0)
        return cls(rig.camera.model, lens.values_of(rig.camera), optics, tuple(views))

    def pixels(self, view: str, points: Array) -> Array:
        """Pixels (N, 2) of points (N, 3) of the rig frame."""
        seen = self.optics.into_camera(self.views.index(view), points)
        return lens.project(self.model, self.intrinsics, seen)

    def pixels_with_derivatives(self, view: str, points: Array) -> tuple[Array, Array]:
        """Pixels (N, 2) and their derivatives (N, 2, 3) by the points."""
        index = self.views.index(view)
        seen = self.optics.into_camera(index, points)
        pixels, by_seen, _ = lens.project_with_derivatives(self.model, self.intrinsics, seen)
        return pixels, by_seen @ self.optics.derivatives(index, points)[0]
