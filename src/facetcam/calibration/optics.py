"""From the rig to the camera through a view's mirrors, with derivatives by what the solver may move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from facetcam.calibration.mirror_planes import Plane
from facetcam.geometry import reflection, se3
from facetcam.geometry.glass import displacement, straightened
from facetcam.rig import Rig
from facetcam.rig.covariance import GLASS, MOTIONS
from facetcam.rig.mirrors import DENSEST, THICKEST

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
    """Views behind flat mirrors: three parameters a mirror, and two of each sheet of glass before some.

    Attributes
    ----------
    names : tuple of str
        The mirrors that some view looks into, in the order of the parameters.
    planes : tuple of Plane
    chains : tuple of tuple of int
        Indices of mirrors a view, in the order a camera ray meets them.
    T_cam_rig : (4, 4) array
    tolerance : (count,) array
        Of the drawing: of the planes first, then of the glass; inf for glass that is held.
    glass : (M, 2) array
        Thickness in metres and refractive index of each mirror; thickness 0 for a first surface.
    drawn : (G, 2) array
        The same in the drawing, of each sheet.
    sheets : tuple of tuple of int
        Mirrors that are cut from one sheet: those of the same glass in the drawing.
    """

    names: tuple[str, ...]
    planes: tuple[Plane, ...]
    chains: tuple[tuple[int, ...], ...]
    T_cam_rig: Array
    tolerance: Array
    glass: Array
    drawn: Array
    sheets: tuple[tuple[int, ...], ...]

    @classmethod
    def of(cls, rig: Rig, views: Sequence[str], tilt: float, shift: float) -> MirrorOptics:
        """The views of a rig; the drawing is good to `tilt` (radians) and `shift` (metres) a mirror."""
        names = tuple(m for m in rig.mirrors if any(m in rig.views[v].mirrors for v in views))
        centre = rig.T_rig_cam[:3, 3]
        planes = tuple(Plane.of(rig.mirrors[m], centre) for m in names)
        chains = tuple(tuple(names.index(m) for m in rig.views[v].mirrors) for v in views)
        # Millimetres suit a rig that fits on a robot; of a mirror metres away a drawing knows less.
        shifts = [max(shift, 0.02 * float(np.linalg.norm(p.pivot - centre))) for p in planes]
        of_planes = np.array([[np.tan(tilt), np.tan(tilt), s] for s in shifts]).reshape(-1)
        panes = [rig.mirrors[m].glass for m in names]
        glass = np.array([(p.thickness, p.index) if p else (0.0, 1.0) for p in panes]).reshape(-1, 2)
        cut = {p: tuple(m for m, q in enumerate(panes) if q == p) for p in panes if p and p.thickness > 0}
        sigmas = np.array([pane.sigmas for pane in cut]).reshape(-1)
        tolerance = np.concatenate([of_planes, np.where(sigmas > 0, sigmas, np.inf)])
        drawn, sheets = glass[[mirrors[0] for mirrors in cut.values()]], tuple(cut.values())
        return cls(names, planes, chains, se3.inverse(rig.T_rig_cam), tolerance, glass, drawn, sheets)

    @property
    def count(self) -> int:
        return 3 * len(self.planes) + 2 * len(self.sheets)

    @property
    def values(self) -> Array:
        """Steps of the planes from the drawing, then thickness and index of the sheets."""
        panes = self.glass[[mirrors[0] for mirrors in self.sheets]].reshape(-1)
        return np.concatenate([np.empty(0), *(p.values for p in self.planes), panes])

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters; a sheet is called by all its mirrors."""
        sheets = [", ".join(self.names[m] for m in mirrors) for mirrors in self.sheets]
        parts = [(self.names, MOTIONS), (sheets, GLASS)]
        return tuple(f"{name}: {word}" for names, words in parts for name in names for word in words)

    @property
    def offsets(self) -> Array:
        begun = np.concatenate([np.zeros(3 * len(self.planes)), self.drawn.reshape(-1)])
        return np.asarray((self.values - begun) / self.tolerance)

    def columns(self, view: int) -> Index:
        planes = [3 * m + i for m in self.chains[view] for i in range(3)]
        own = {m: 3 * len(self.planes) + 2 * g for g, mirrors in enumerate(self.sheets) for m in mirrors}
        panes = [own[m] + i for m in self.chains[view] if m in own for i in (0, 1)]
        return np.array(planes + panes, dtype=np.int64)

    def T_image_rig(self, view: int) -> Array:
        """The signed pose (4, 4) of a view, its glass aside."""
        return self._maps[view][0]

    def into_camera(self, view: int, points: Array) -> Array:
        seen = se3.transform(self.T_image_rig(view), points)
        panes = self.panes(view)
        return seen if panes is None else straightened(seen, *panes)[0]

    def derivatives(self, view: int, points: Array) -> tuple[Array, Array]:
        E, by_planes = self._maps[view]
        by_points: Array = np.broadcast_to(E[:3, :3], (len(points), 3, 3))
        by_values = np.einsum("pij,nj->nip", by_planes[:, :3, :3], points) + by_planes[:, :3, 3].T
        if self.panes(view) is None:
            return by_points, by_values
        through, by_panes = self._through_glass(view, points)
        by_panes[:, :, : by_values.shape[2]] += by_values
        return through @ by_points, through @ by_panes

    def panes(self, view: int) -> tuple[Array, Array] | None:
        """Unfolded normals and glass of the view's chain, as `geometry.glass` takes them; None without."""
        chain = self.chains[view]
        if not any(m in sum(self.sheets, ()) or self.glass[m, 0] > 0 for m in chain):
            return None
        turn, normals = self.T_cam_rig[:3, :3], []
        for m in chain:
            normals.append(turn @ self.planes[m].plane[0])
            turn = turn @ self.planes[m].reflection[:3, :3]
        return np.array(normals), np.maximum(self.glass[list(chain)], (0.0, 1.0 + 1e-9))

    def _through_glass(self, view: int, points: Array) -> tuple[Array, Array]:
        """How the straightened point follows the unfolded one (N, 3, 3), and what normals and glass add."""
        seen = self.into_camera(view, points)
        through = follow_through(seen, _some(self.panes(view)))
        directions = seen / np.linalg.norm(seen, axis=1)[:, None]
        by_panes = np.zeros((len(points), 3, len(self.columns(view))))
        # A chain may meet a mirror or a sheet twice: its columns repeat, and what it adds counts once.
        for parameter, column in zip(*np.unique(self.columns(view), return_index=True)):
            if parameter < 3 * len(self.planes) and parameter % 3 == 2:
                continue  # a shift leaves normals and glass alone
            nudge = np.zeros(self.count)
            nudge[parameter] = 1e-6
            ends = [displacement(directions, *_some(self.moved(n).panes(view))) for n in (nudge, -nudge)]
            by_panes[:, :, column] = -(ends[0] - ends[1]) / 2e-6
        return through, by_panes

    def moved(self, step: Array) -> MirrorOptics:
        of_planes, of_glass = np.split(step, [3 * len(self.planes)])
        planes = tuple(replace(p, values=p.values + s) for p, s in zip(self.planes, of_planes.reshape(-1, 3)))
        glass = self.glass.copy()
        for mirrors, change in zip(self.sheets, of_glass.reshape(-1, 2)):
            glass[list(mirrors)] += change
        return replace(self, planes=planes, glass=glass)

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
        for m, (name, plane) in enumerate(zip(self.names, self.planes)):
            mirrors[name] = plane.moved(rig.mirrors[name])
            pane = mirrors[name].glass
            if pane is not None:
                thickness, index = np.clip(self.glass[m], (0.0, 1.0 + 1e-9), (THICKEST, DENSEST)).tolist()
                mirrors[name] = replace(mirrors[name], glass=replace(pane, thickness=thickness, index=index))
        return replace(rig, mirrors=mirrors)


def follow_through(seen: Array, panes: tuple[Array, Array]) -> Array:
    """Derivatives (N, 3, 3) of points straightened behind glass, `seen`, by the points before.

    Differences: the displacement is smooth, small, and enters the projection a hundred times weaker than the
    point itself.
    """
    step = 1e-6 * np.linalg.norm(seen, axis=1)[:, None]
    slope = np.empty((len(seen), 3, 3))
    for axis in range(3):
        ends = [seen + sign * step * np.eye(3)[axis] for sign in (1, -1)]
        more, less = (displacement(e / np.linalg.norm(e, axis=1)[:, None], *panes) for e in ends)
        slope[:, :, axis] = (more - less) / (2 * step)
    return np.asarray(np.linalg.inv(np.eye(3) + slope), dtype=np.float64)


def _some(panes: tuple[Array, Array] | None) -> tuple[Array, Array]:
    assert panes is not None
    return panes
