"""From the rig to the camera through a view's mirrors, with derivatives by what the solver may move."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from facetcam.calibration.mirror_planes import Plane
from facetcam.geometry import reflection, se3
from facetcam.geometry.glass import displacement, straightened
from facetcam.rig import Rig

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class Optics(Protocol):
    """What the solver asks of a model of the views."""

    @property
    def count(self) -> int:
        """Number of parameters."""

    @property
    def offsets(self) -> Array:
        """Value of each parameter against the drawing, in units of the drawing's tolerance, (count,)."""

    @property
    def tolerance(self) -> Array:
        """Tolerance of the drawing in each parameter; inf where the drawing says nothing, (count,)."""

    def columns(self, view: int) -> Index:
        """Parameters on which a view depends."""

    def into_camera(self, view: int, points: Array) -> Array:
        """Points (N, 3) of the rig frame where the real camera seems to see them in a view."""

    def derivatives(self, view: int, points: Array) -> tuple[Array, Array]:
        """Derivatives of `into_camera` by the points (N, 3, 3) and by those of `columns` (N, 3, C)."""

    def moved(self, step: Array) -> Self:
        """The model after a step (count,) of its parameters."""


@dataclass(frozen=True, eq=False)
class MirrorOptics:
    """Views behind flat mirrors, three parameters a mirror; glass before them is taken as given.

    Attributes
    ----------
    names : tuple of str
        The mirrors that some view looks into, in the order of the parameters.
    planes : tuple of Plane
    chains : tuple of tuple of int
        Indices of mirrors a view, in the order a camera ray meets them.
    T_cam_rig : (4, 4) array
    tolerance : (3 M,) array
    glass : (M, 2) array
        Thickness in metres and refractive index of each mirror; thickness 0 for a first surface.
    """

    names: tuple[str, ...]
    planes: tuple[Plane, ...]
    chains: tuple[tuple[int, ...], ...]
    T_cam_rig: Array
    tolerance: Array
    glass: Array

    @classmethod
    def of(cls, rig: Rig, views: Sequence[str], tilt: float, shift: float) -> MirrorOptics:
        """The views of a rig; the drawing is good to `tilt` (radians) and `shift` (metres) a mirror."""
        names = tuple(m for m in rig.mirrors if any(m in rig.views[v].mirrors for v in views))
        centre = rig.T_rig_cam[:3, 3]
        planes = tuple(Plane.of(rig.mirrors[m], centre) for m in names)
        chains = tuple(tuple(names.index(m) for m in rig.views[v].mirrors) for v in views)
        # Millimetres suit a rig that fits on a robot; of a mirror metres away a drawing knows less.
        shifts = [max(shift, 0.02 * float(np.linalg.norm(p.pivot - centre))) for p in planes]
        tolerance = np.array([[np.tan(tilt), np.tan(tilt), s] for s in shifts]).reshape(-1)
        panes = [rig.mirrors[m].glass for m in names]
        glass = np.array([(p.thickness, p.index) if p else (0.0, 1.0) for p in panes]).reshape(-1, 2)
        return cls(names, planes, chains, se3.inverse(rig.T_rig_cam), tolerance, glass)

    @property
    def count(self) -> int:
        return 3 * len(self.planes)

    @property
    def offsets(self) -> Array:
        values = np.concatenate([np.empty(0), *(p.values for p in self.planes)])
        return np.asarray(values / self.tolerance)

    def columns(self, view: int) -> Index:
        return np.array([3 * m + i for m in self.chains[view] for i in range(3)], dtype=np.int64)

    def into_camera(self, view: int, points: Array) -> Array:
        seen = se3.transform(self._maps[view][0], points)
        panes = self._panes(view)
        return seen if panes is None else straightened(seen, *panes)[0]

    def derivatives(self, view: int, points: Array) -> tuple[Array, Array]:
        E, by_planes = self._maps[view]
        by_points: Array = np.broadcast_to(E[:3, :3], (len(points), 3, 3))
        by_values = np.einsum("pij,nj->nip", by_planes[:, :3, :3], points) + by_planes[:, :3, 3].T
        if self._panes(view) is None:
            return by_points, by_values
        through, by_normals = self._through_glass(view, points)
        return through @ by_points, through @ (by_values + by_normals)

    def _panes(self, view: int) -> tuple[Array, Array] | None:
        """Unfolded normals and glass of the view's chain, as `geometry.glass` takes them; None without."""
        chain = self.chains[view]
        if not any(self.glass[m, 0] > 0 for m in chain):
            return None
        turn, normals = self.T_cam_rig[:3, :3], []
        for m in chain:
            normals.append(turn @ self.planes[m].plane[0])
            turn = turn @ self.planes[m].reflection[:3, :3]
        return np.array(normals), np.maximum(self.glass[list(chain)], (0.0, 1.0 + 1e-9))

    def _through_glass(self, view: int, points: Array) -> tuple[Array, Array]:
        """How the straightened point follows the unfolded one (N, 3, 3), and what the normals' turn adds.

        Differences: the displacement is smooth, small, and enters the projection a hundred times weaker than
        the point itself.
        """
        panes = self._panes(view)
        assert panes is not None
        seen = self.into_camera(view, points)
        step = 1e-6 * np.linalg.norm(seen, axis=1)[:, None]
        slope = np.empty((len(points), 3, 3))
        for axis in range(3):
            ends = [seen + sign * step * np.eye(3)[axis] for sign in (1, -1)]
            more, less = (displacement(e / np.linalg.norm(e, axis=1)[:, None], *panes) for e in ends)
            slope[:, :, axis] = (more - less) / (2 * step)
        directions = seen / np.linalg.norm(seen, axis=1)[:, None]
        by_normals = np.zeros((len(points), 3, len(self.columns(view))))
        for column, parameter in enumerate(self.columns(view)):
            if parameter % 3 < 2:
                nudge = np.zeros(self.count)
                nudge[parameter] = 1e-6
                ends = [displacement(directions, *_some(self.moved(n)._panes(view))) for n in (nudge, -nudge)]
                by_normals[:, :, column] = -(ends[0] - ends[1]) / 2e-6
        return np.asarray(np.linalg.inv(np.eye(3) + slope), dtype=np.float64), by_normals

    def moved(self, step: Array) -> MirrorOptics:
        steps = step.reshape(-1, 3)
        return replace(
            self, planes=tuple(replace(p, values=p.values + s) for p, s in zip(self.planes, steps))
        )

    @cached_property
    def _maps(self) -> list[tuple[Array, Array]]:
        """Per view T_image_rig = T_cam_rig S_1 ... S_k, and its derivatives (3 k, 4, 4)."""
        return [self._map(chain) for chain in self.chains]

    def _map(self, chain: tuple[int, ...]) -> tuple[Array, Array]:
        S = [self.planes[m].reflection for m in chain]
        by_planes = []
        for place, m in enumerate(chain):
            before = self.T_cam_rig @ reflection.chain(S[:place][::-1])
            after = reflection.chain(S[place + 1 :][::-1])
            by_planes.append(before @ self.planes[m].derivatives @ after)
        return self.T_cam_rig @ reflection.chain(S[::-1]), np.concatenate([np.empty((0, 4, 4)), *by_planes])

    def rig(self, rig: Rig) -> Rig:
        """`rig` with these mirrors; polygons move with their planes."""
        mirrors = dict(rig.mirrors)
        for name, plane in zip(self.names, self.planes):
            mirrors[name] = plane.moved(rig.mirrors[name])
        return replace(rig, mirrors=mirrors)


def _some(panes: tuple[Array, Array] | None) -> tuple[Array, Array]:
    assert panes is not None
    return panes


@dataclass(frozen=True, eq=False)
class FreeOptics:
    """Views with any pose: six parameters a view, from no drawing; for what mirrors do not explain."""

    T_image_rig: Array  # (V, 4, 4), of determinant -1 for mirror images

    @classmethod
    def of(cls, optics: Mapping[int, Array] | Sequence[Array]) -> FreeOptics:
        """Views at these signed poses T_image_rig."""
        return cls(np.array(optics))

    @property
    def count(self) -> int:
        return 6 * len(self.T_image_rig)

    @property
    def offsets(self) -> Array:
        return np.zeros(self.count)

    @property
    def tolerance(self) -> Array:
        return np.full(self.count, np.inf)

    def columns(self, view: int) -> Index:
        return np.arange(6 * view, 6 * view + 6)

    def into_camera(self, view: int, points: Array) -> Array:
        return se3.transform(self.T_image_rig[view], points)

    def derivatives(self, view: int, points: Array) -> tuple[Array, Array]:
        R = self.T_image_rig[view, :3, :3]
        seen = self.into_camera(view, points)
        by_values = np.concatenate([-se3.skew(seen), np.broadcast_to(np.eye(3), (len(points), 3, 3))], axis=2)
        return np.broadcast_to(R, (len(points), 3, 3)), by_values

    def moved(self, step: Array) -> FreeOptics:
        steps = step.reshape(-1, 6)
        return FreeOptics(np.array([se3.exp(s) @ T for s, T in zip(steps, self.T_image_rig)]))
