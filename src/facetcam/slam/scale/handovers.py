"""Hand-overs: what one view has mapped, sought in the others whatever the scale of the map may be.

A map of a wrong scale keeps the few sightings in other views that happen to fit it, and these confirm it.
What is sought over a range of scales, and kept wherever it is found, cannot be chosen by the scale.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from facetcam.geometry import se3
from facetcam.slam.adjustment.adjuster import Adjuster
from facetcam.slam.adjustment.information import typical_noise
from facetcam.slam.camera.optics import Optics
from facetcam.slam.camera.shutter import at_one_moment
from facetcam.slam.config import SlamConfig
from facetcam.slam.map.map import HandedOver, Keyframe, Map, Observations
from facetcam.slam.map.measure import measure
from facetcam.slam.scale.evidence import LARGEST, Evidence, scale_evidence
from facetcam.slam.scale.search import expected_elsewhere, home_of_points, rescale

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_FACTORS = np.exp(np.linspace(-LARGEST, LARGEST, 31))  # patches are drawn in over the steps between
_FEW_FACTORS = _FACTORS[::6]
_NEAR = 25  # keyframes before and after, whose points are sought
_ONE_PLACE = 1.0  # px
_LEAST_FINDS = 2  # scales from which a point must be found at its place
_AHEAD = 5.0  # logarithm of how much likelier another scale must be before the map goes over to it


class Handovers:
    """Seeks hand-overs in keyframes, and tells what they say of the map's scale.

    Parameters
    ----------
    map : Map
    optics : Optics
    config : SlamConfig
    adjuster : Adjuster

    Attributes
    ----------
    tell : bool
        Whether they told a scale when they were asked last.
    """

    def __init__(self, map: Map, optics: Optics, config: SlamConfig, adjuster: Adjuster) -> None:
        self._map = map
        self._optics = optics
        self._config = config
        self._adjuster = adjuster
        self.tell = False

    def seek(self, keyframes: list[Keyframe]) -> None:
        """Look for points of the keyframes around each one in those of its views that did not map them."""
        views, points = home_of_points(self._map), self._map.points
        for keyframe in keyframes:
            assert keyframe.frame is not None
            ids = self._within_reach(keyframe, views)
            expected, _ = expected_elsewhere(points, ids, views, keyframe, _FACTORS, self._optics)
            found, _ = measure(keyframe.frame, expected, points, self._optics, self._config)
            sightings = HandedOver(found.point, views[found.point], found.view, found.pixels)
            keyframe.handovers = _at_one_place(sightings)

    def _within_reach(self, keyframe: Keyframe, views: NDArray[np.int8]) -> Index:
        """Points of the keyframes around one that other views might see at some scale: none that repeats."""
        first, last = keyframe.index - _NEAR, keyframe.index + _NEAR + 1
        ids = self._map.observed_points(self._map.keyframes[max(first, 0) : last])
        points_rig = se3.transform(se3.inverse(keyframe.T_world_rig), self._map.points.xyz[ids])
        seen = np.any([self._optics.project(f * points_rig)[1] for f in _FEW_FACTORS], axis=0)
        seen[views[ids], np.arange(len(ids))] = False
        seen &= ~self._map.points.repeated[ids]
        return np.asarray(ids[seen.any(axis=0)])

    def take_up(self) -> None:
        """Add hand-overs to the map; where they deny its scale, it goes over to theirs."""
        self.seek([k for k in self._map.keyframes if k.frame is not None])
        telling = self._telling()
        evidence = self._evidence(telling)
        denied = abs(evidence.stretch) > 3.0 * evidence.sigma
        if not evidence.points or (denied and evidence.ahead < _AHEAD):
            return
        with self._map.lock:
            if denied:
                rescale(self._map, float(np.exp(evidence.stretch)), self._optics)
            self._add(telling, evidence.agrees)
        if denied:
            self._adjuster.adjust_coarsely()

    def evidence(self) -> Evidence:
        """What the hand-overs say of the scale of the map as it is."""
        return self._evidence(self._telling())

    def _evidence(self, sought: list[HandedOver]) -> Evidence:
        whole = self._adjuster.whole(swept=False)
        if whole is None:
            return Evidence.none()
        ids = self._map.observed_points(self._map.keyframes)
        home = np.concatenate([s.home for s in sought])
        sightings = replace(
            whole,
            frame=np.repeat(np.arange(len(sought)), [len(s) for s in sought]),
            view=np.concatenate([s.view for s in sought]).astype(np.int64),
            point=np.searchsorted(ids, np.concatenate([s.point for s in sought])),
            plane=np.concatenate([self._plane(k, s) for k, s in zip(self._map.keyframes, sought)]),
        ).on_edges(self._map.points.edges(ids), self._optics)
        noise = typical_noise(whole, self._optics, self._config.pixel_sigma)
        evidence = scale_evidence(whole, sightings, home, self._optics, noise)
        self.tell = bool(np.isfinite(evidence.sigma))
        return evidence

    def _telling(self) -> list[HandedOver]:
        """The hand-overs of each keyframe that can tell the scale, and whose points the map still has."""
        if not self._map.keyframes:
            return []
        alive = self._map.points.alive
        living = [k.handovers.take(alive[k.handovers.point]) for k in self._map.keyframes]
        return mapped_nearby(self._map.keyframes, living, self._config.min_inliers)

    def _plane(self, keyframe: Keyframe, found: HandedOver) -> Array:
        """Where they lie on the ideal pinholes, as a global shutter would show them."""
        xyz, readout = self._map.points.xyz[found.point], self._map.readout
        seen = (found.view, found.pixels)
        return at_one_moment(keyframe.T_world_rig, keyframe.velocity, xyz, *seen, readout, self._optics)

    def _add(self, telling: list[HandedOver], agrees: NDArray[np.bool_]) -> None:
        """Let keyframes see those of their hand-overs that agree."""
        first = 0
        for keyframe, found in zip(self._map.keyframes, telling):
            seen = keyframe.observations
            rows, first = agrees[first : first + len(found)], first + len(found)
            found = found.take(rows & ~seen.has(found.point, found.view))
            plane = self._optics.plane(found.pixels, found.view)
            seen.append(found.point, found.view, found.pixels, plane)


def mapped_nearby(keyframes: list[Keyframe], found: list[HandedOver], least: int) -> list[HandedOver]:
    """Hand-overs of each keyframe, less those of points that were mapped in another part of the map.

    Keyframes are one part where single views tie them, each of which sees `least` points again. Hand-overs
    from part to part have themselves placed the one after the other: they agree at any scale.
    """
    seen = [k.observations for k in keyframes]
    part = _parts(seen, least)
    mapped = np.concatenate([_names(p, s.point, s.view) for p, s in zip(part, seen)])
    kept = np.isin(np.concatenate([_names(p, f.point, f.home) for p, f in zip(part, found)]), mapped)
    ends = np.cumsum([len(f) for f in found])
    return [f.take(kept[end - len(f) : end]) for f, end in zip(found, ends)]


def _parts(seen: list[Observations], least: int) -> Index:
    """Part (K,) of the map to which each keyframe belongs."""
    names = [_names(0, s.point, s.view) for s in seen]
    every, columns = np.unique(np.concatenate(names), return_inverse=True)
    start = np.cumsum([0, *(len(n) for n in names)])
    sight = csr_matrix((np.ones(len(columns), np.int32), columns, start), shape=(len(seen), len(every)))
    return np.asarray(connected_components((sight @ sight.T) >= least, directed=False)[1])


def _names(part: int, point: Index, view: NDArray[np.int8]) -> Index:
    """One number for each point as a view of a part of the map sees it."""
    return (np.int64(part) << 40) + point * 128 + view


def _at_one_place(found: HandedOver) -> HandedOver:
    """Sightings of each (point, view) pair as one, of those found again and again and nowhere else."""
    pair, row, times = np.unique(found.point * 128 + found.view, return_inverse=True, return_counts=True)
    low, high = np.full((len(pair), 2), np.inf), np.full((len(pair), 2), -np.inf)
    np.minimum.at(low, row, found.pixels)
    np.maximum.at(high, row, found.pixels)
    sure = (times >= _LEAST_FINDS) & np.all(high - low < _ONE_PLACE, axis=1)
    return found.take(np.unique(row, return_index=True)[1][sure])
