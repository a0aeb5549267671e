"""Bundle adjustment of the window and of the whole map, and what is culled after it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from facetcam.geometry import se3
from facetcam.slam.adjustment.bundle import Bundle, RelativePose, adjust, growth
from facetcam.slam.adjustment.information import typical_noise
from facetcam.slam.adjustment.map_uncertainty import MapUncertainty, map_uncertainty
from facetcam.slam.adjustment.wheel_steps import WheelSteps
from facetcam.slam.camera.nuisances import Nuisances, believed, shift_by_creep
from facetcam.slam.camera.optics import Optics
from facetcam.slam.camera.shutter import sweep
from facetcam.slam.config import SlamConfig
from facetcam.slam.map.map import Keyframe, Map, shared_points

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_LOCAL_STOP = (10, 1e-4)  # iterations, relative change of the cost
_GLOBAL_STOP = (30, 1e-6)
_LAST_STOP = (100, 1e-8)  # the scale of a map converges slowly
_LOSS = 0.8  # standard deviations of a measurement at which its loss flattens: the scale needs a tight one
_COARSE_LOSSES = (60.0, 10.0)
_SCALE_HOLD = 0.3
_MAX_FIXED = 10
_MAX_NEAR = 50  # keyframes among which these are sought
_TRIALS = 8
_LEAST_FOUND = 0.3  # share of the trials in which a good point is found


class Adjuster:
    """Adjusts keyframes and points together.

    Parameters
    ----------
    map : Map
    optics : Optics
    config : SlamConfig

    Attributes
    ----------
    wheels : WheelSteps
        What odometry adds to the images.
    """

    def __init__(self, map: Map, optics: Optics, config: SlamConfig) -> None:
        self.wheels = WheelSteps(config.odometry_sigma)
        self._map = map
        self._optics = optics
        self._config = config

    @property
    def window(self) -> list[Keyframe]:
        """The keyframes that are adjusted together, oldest first: none from before a gap."""
        return self._map.keyframes[self._map.since :][-self._config.window :]

    @property
    def nuisances(self) -> Array:
        """Readout in seconds and creep (x, y) in pixels, as they are believed to be."""
        return np.array([self._map.readout, *self._map.creep])

    def believe(self, nuisances: Array) -> None:
        """Go over to other `nuisances`."""
        with self._map.lock:
            self._go_over_to(nuisances)

    def _go_over_to(self, nuisances: Array) -> None:
        self._map.readout, self._map.creep = float(nuisances[0]), nuisances[1:]
        self._map.see_through(self._optics)

    def adjust_window(self) -> None:
        """Adjust the window; older keyframes that share its points hold it in place."""
        window = self.window
        ids = self._map.observed_points(window)
        near = self._map.near(window[-1].T_world_rig[:3, 3], _MAX_NEAR + len(window))
        older = sorted((k for k in near if k.index < window[0].index), key=lambda k: k.index)
        wanted = np.zeros(len(self._map.points), dtype=bool)
        wanted[ids] = True
        shared = [int(wanted[k.observations.point].sum()) for k in older]
        anchors = [older[i] for i in np.argsort(shared, kind="stable")[::-1][:_MAX_FIXED] if shared[i]]
        anchors.sort(key=lambda k: k.index)
        self._adjust(anchors + window, len(anchors) or 1, ids, _LOCAL_STOP)

    def adjust_all(self, last: bool = False) -> None:
        """Adjust every keyframe and point, the first keyframe held; the last time more thoroughly."""
        if len(self._map.keyframes) > 1:
            everything = self._map.observed_points(self._map.keyframes)
            self._adjust(self._map.keyframes, 1, everything, _LAST_STOP if last else _GLOBAL_STOP, swept=True)

    def adjust_coarsely(self) -> None:
        """Adjust a whole map that is bent: losses begin wide, and nothing is culled yet."""
        if len(self._map.keyframes) < 2:
            return
        everything = self._map.observed_points(self._map.keyframes)
        for loss in _COARSE_LOSSES:
            self._adjust(self._map.keyframes, 1, everything, _GLOBAL_STOP, loss)

    def judge(self) -> float:
        """Give every keyframe its covariance; returns the relative standard deviation of the scale.

        It is inf where the images cannot tell the scale.
        """
        bundle = self.whole()
        if bundle is None:
            return np.inf
        found = self._give_covariances(bundle)
        if bundle.nuisances is not None and len(found.nuisance_step):
            now = believed(bundle.nuisances.values + found.nuisance_step, found.nuisance_covariance)
            if np.any((now == 0.0) != (self.nuisances == 0.0)):  # else the map has settled with them
                self.believe(now)
        return found.scale_sigma

    def give_covariances(self) -> None:
        """Give every keyframe its covariance, also where the map is too young to be judged."""
        bundle = self.whole()
        if bundle is not None:
            self._give_covariances(bundle)

    def _give_covariances(self, bundle: Bundle) -> MapUncertainty:
        found = map_uncertainty(bundle, self._optics, self._config.pixel_sigma)
        for keyframe, covariance in zip(self._map.keyframes, found.covariance):
            keyframe.covariance, keyframe.drift = covariance, np.zeros((6, 6))
        return found

    def whole(self, swept: bool = True) -> Bundle | None:
        """All keyframes and the points that they saw as one problem, the first keyframe held.

        Without `swept` it lacks what a readout of the shutter would do, unless one is known.
        """
        ids = self._map.observed_points(self._map.keyframes)
        if not len(ids):
            return None
        bundle = self._bundle(self._map.keyframes, 1, ids, swept)[0]
        bundle.bridges = [m for m in self.wheels.between(self._map.keyframes) if self._lost_between(m.i, m.j)]
        return bundle

    def _lost_between(self, i: int, j: int) -> bool:
        """Tell whether hardly a point joins two keyframes: nothing but wheels went from one to the other."""
        return shared_points(self._map.keyframes[i], self._map.keyframes[j]) < self._config.min_inliers

    def _adjust(
        self,
        keyframes: list[Keyframe],
        n_fixed: int,
        ids: Index,
        stop: tuple[int, float],
        loss: float = _LOSS,
        swept: bool = False,
    ) -> None:
        with self._map.lock:
            bundle, used = self._bundle(keyframes, n_fixed, ids, swept)
        if not len(used):
            return
        sigma, noise = self._config.pixel_sigma, 1.0
        if bundle.nuisances is not None:
            bundle.nuisances = bundle.nuisances.believed()
            noise = typical_noise(bundle, self._optics, sigma)
        poses, xyz, nuisances = adjust(bundle, self._optics, loss * sigma, *stop, noise=noise)
        of_keyframes, of_points = growth(bundle, poses, xyz, self._optics)
        with self._map.lock:
            self._map.points.xyz[used] = xyz
            self._map.points.tangent[used] *= of_points[:, None, None]  # a pixel is a longer step from afar
            for keyframe, T, factor in zip(keyframes, poses, of_keyframes):
                keyframe.T_world_rig = T
                keyframe.grow(float(factor))
            if len(nuisances):
                self._go_over_to(np.pad(nuisances, (0, 3 - len(nuisances))))
            if loss == _LOSS:
                self._cull(keyframes, used)

    def _bundle(
        self, keyframes: list[Keyframe], n_fixed: int, ids: Index, swept: bool = False
    ) -> tuple[Bundle, Index]:
        """What the keyframes saw of some points as one problem, and the ids of its points."""
        wanted, seen = np.zeros((2, len(self._map.points)), dtype=bool)
        wanted[ids] = True
        rows = [wanted[k.observations.point] for k in keyframes]
        point = np.concatenate([k.observations.point[r] for k, r in zip(keyframes, rows)])
        seen[point] = True
        used, index = np.flatnonzero(seen), np.cumsum(seen) - 1
        fixed = np.arange(len(keyframes)) < n_fixed
        plane = np.concatenate([k.observations.plane[r] for k, r in zip(keyframes, rows)])
        view = np.concatenate([k.observations.view[r] for k, r in zip(keyframes, rows)]).astype(np.int64)
        nuisances = None
        if self._map.readout or swept:
            shift = np.concatenate([self._sweep(k, r) for k, r in zip(keyframes, rows)])
            plane = plane - self._map.readout * shift
            nuisances = self._nuisances(plane, view, shift) if swept else None
        bundle = Bundle(
            T_world_rig=np.stack([k.T_world_rig for k in keyframes]),
            fixed=fixed,
            points=self._map.points.xyz[used],
            frame=np.repeat(np.arange(len(keyframes)), [int(r.sum()) for r in rows]),
            view=view,
            point=index[point],
            plane=plane,
            motions=self._motions(keyframes, n_fixed),
            nuisances=nuisances,
        )
        return bundle.on_edges(self._map.points.edges(used), self._optics), used

    def _nuisances(self, plane: Array, view: Index, by_readout: Array) -> Nuisances:
        several = self._optics.n_views > 1
        by_creep = shift_by_creep(plane, view, self._optics) if several else None
        return Nuisances.of(self._map.readout, self._map.creep, by_readout, by_creep)

    def _sweep(self, keyframe: Keyframe, rows: NDArray[np.bool_]) -> Array:
        """What a second of readout does to some observations of a keyframe."""
        seen, T = keyframe.observations, keyframe.T_world_rig
        xyz = self._map.points.xyz[seen.point[rows]]
        return sweep(T, keyframe.velocity, xyz, seen.view[rows], seen.pixels[rows], self._optics)

    def _motions(self, keyframes: list[Keyframe], n_fixed: int) -> list[RelativePose]:
        """Odometry between neighbours in time, and a loose hold on a scale that nothing else may hold."""
        hold = [_hold_scale(keyframes)] if n_fixed == 1 and len(keyframes) > 1 else []
        return hold + self.wheels.between(keyframes, max(1, n_fixed))

    def _cull(self, keyframes: list[Keyframe], ids: Index) -> None:
        """Drop observations that do not fit, then points seen from one place only or rarely found."""
        points = self._map.points
        for keyframe in keyframes:
            seen = keyframe.observations
            points_rig = se3.transform(se3.inverse(keyframe.T_world_rig), points.xyz[seen.point])
            plane, depth = self._optics.to_plane(points_rig, seen.view)
            if self._map.readout:
                plane += self._map.readout * self._sweep(keyframe, np.ones(len(seen), dtype=bool))
            fits = (np.linalg.norm(plane - seen.plane, axis=1) < self._config.gate) & (depth > 0)
            seen.keep(fits & points.alive[seen.point])
        counts = np.bincount(
            np.concatenate([k.observations.point for k in keyframes]), minlength=len(points)
        )[ids]
        tried = points.predicted[ids]
        rare = (tried > _TRIALS) & (points.found[ids] < _LEAST_FOUND * tried)
        points.alive[ids[(counts < 2) | rare]] = False


def _hold_scale(keyframes: list[Keyframe]) -> RelativePose:
    """Keep the distance of the two ends to its present value within `_SCALE_HOLD`.

    Where the views determine the scale this is far too loose to matter; where they do not, the scale would
    run away.
    """
    T = se3.inverse(keyframes[0].T_world_rig) @ keyframes[-1].T_world_rig
    sigma = _SCALE_HOLD * max(float(np.linalg.norm(T[:3, 3])), 1e-3)
    return RelativePose(0, len(keyframes) - 1, T, np.diag([1.0, 1.0, 1.0, *(3 * [sigma**2])]))
