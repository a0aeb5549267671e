"""What a rig sees, in numbers: each view, the rig as a whole."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from facetcam.design import cones
from facetcam.design.areas import Area, azimuth_elevation, direction_grid, view_areas
from facetcam.design.seams import Seam, Wedge, seams, wedges
from facetcam.design.sensor import SensorMap, sensor_map
from facetcam.design.spec import Body, Optics
from facetcam.errors import RigError
from facetcam.rig import Rig

Array = NDArray[np.float64]

HORIZON_STEPS = 3600


@dataclass(frozen=True, slots=True)
class ViewFacts:
    """One view (radians, metres, steradians).

    Attributes
    ----------
    chain : tuple of str
    mirrored : bool
        Whether the raw frame shows it as a mirror image.
    solid_angle : float
    sensor_share : float
    per_degree : tuple of float
        Least, mean and most pixels a degree.
    polygon : list of (N, 2) arrays
        Closed outlines of what it sees of far things: azimuth from the front to the right, elevation.
    azimuth, elevation : tuple of float
        Extent about the azimuth of the view's middle; azimuths may pass pi.
    centre : (3,) array
        The virtual camera in the rig frame.
    baseline : float
        Distance to the nearest other centre; nan for a single view.
    """

    chain: tuple[str, ...]
    mirrored: bool
    solid_angle: float
    sensor_share: float
    per_degree: tuple[float, float, float]
    polygon: list[Array]
    azimuth: tuple[float, float]
    elevation: tuple[float, float]
    centre: Array
    baseline: float


@dataclass(frozen=True, slots=True)
class Analysis:
    """A rig on paper: areas, numbers of each view, and what becomes of every pixel."""

    rig: Rig
    areas: dict[str, Area]
    views: dict[str, ViewFacts]
    sensor: SensorMap
    wedges: list[Wedge]
    seams: list[Seam]
    spread: float  # metres between the two view centres that are farthest apart
    spread_rms: float  # metres, about their mean
    horizon: float  # share of all azimuths that some view sees at elevation 0
    sphere: float  # share of all directions that some view sees
    overlap: float  # share of all directions that two or more views see


def analyse(rig: Rig, body: Body, optics: Optics, step: int = 1) -> Analysis:
    """Work out everything that a drawing tells, for far things; see `Analysis`.

    Raises
    ------
    RigError
        If the camera's body leaves nothing of a view.
    """
    areas = view_areas(rig, body)
    for name, area in areas.items():
        if area.solid_angle < 1e-9:
            raise RigError(f"view '{name}': the camera's body hides all of it; move the camera or shrink it")
    sensor = sensor_map(rig, body, step)
    centres = np.array([rig.T_rig_image(name)[:3, 3] for name in rig.views])
    gaps = np.linalg.norm(centres[:, None] - centres[None], axis=2)
    grid, weights = direction_grid()
    times_seen = np.sum([area.sees(grid) for area in areas.values()], axis=0)
    return Analysis(
        rig=rig,
        areas=areas,
        views={name: _facts(rig, name, areas[name], sensor, centres, gaps) for name in rig.views},
        sensor=sensor,
        wedges=wedges(rig),
        seams=seams(rig, areas, optics),
        spread=float(gaps.max()),
        spread_rms=float(np.sqrt(((centres - centres.mean(axis=0)) ** 2).sum(axis=1).mean())),
        horizon=float(np.mean(seen_on_horizon(areas))),
        sphere=float(weights[times_seen > 0].sum() / weights.sum()),
        overlap=float(weights[times_seen > 1].sum() / weights.sum()),
    )


def seen_on_horizon(areas: dict[str, Area], steps: int = HORIZON_STEPS) -> NDArray[np.bool_]:
    """Whether any view sees the horizon at azimuths from -pi to pi."""
    azimuth = (np.arange(steps) + 0.5) * math.tau / steps - math.pi
    directions = np.stack([np.sin(azimuth), np.cos(azimuth), np.zeros(steps)], axis=1)
    seen: NDArray[np.bool_] = np.any([area.sees(directions) for area in areas.values()], axis=0)
    return seen


def gaps_of(seen: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Start and end, in radians from -pi, of each stretch of azimuths that is not seen; may pass pi."""
    if seen.all():
        return []
    if not seen.any():
        return [(-math.pi, math.pi)]
    step = math.tau / len(seen)
    turned = int(np.argmax(seen))  # begin inside what is seen, so that no gap is cut in two
    edges = np.flatnonzero(np.diff(np.concatenate([np.roll(seen, -turned), [True]]).astype(int)))
    return [
        ((a + 1 + turned) * step - math.pi, (b + 1 + turned) * step - math.pi)
        for a, b in zip(edges[::2], edges[1::2])
    ]


def _facts(rig: Rig, name: str, area: Area, sensor: SensorMap, centres: Array, gaps: Array) -> ViewFacts:
    index = rig.view_names.index(name)
    polygon = [_in_angles(cones.densify(ring) @ area.R.T) for ring in area.outlines()]
    everywhere = np.vstack(polygon)
    middle = _middle_azimuth(area)
    turned = np.remainder(everywhere[:, 0] - middle + math.pi, math.tau) - math.pi + middle
    azimuth, elevation = (turned.min(), turned.max()), (everywhere[:, 1].min(), everywhere[:, 1].max())
    down, up = area.sees(np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]))
    if down or up:  # a pole inside the outline, all round which it goes
        azimuth = (-math.pi, math.pi)
        elevation = (-math.pi / 2 if down else elevation[0], math.pi / 2 if up else elevation[1])
    per_degree = sensor.per_degree[sensor.view == index]
    density = (per_degree.min(), per_degree.mean(), per_degree.max()) if len(per_degree) else (0.0, 0.0, 0.0)
    others = np.delete(gaps[index], index)
    least, mean, most = (float(d) for d in density)
    return ViewFacts(
        chain=rig.views[name].mirrors,
        mirrored=rig.is_flipped(name),
        solid_angle=area.solid_angle,
        sensor_share=sensor.share(index),
        per_degree=(least, mean, most),
        polygon=polygon,
        azimuth=(float(azimuth[0]), float(azimuth[1])),
        elevation=(float(elevation[0]), float(elevation[1])),
        centre=centres[index],
        baseline=float(others.min()) if len(others) else math.nan,
    )


def _in_angles(directions: Array) -> Array:
    return np.column_stack(azimuth_elevation(directions))


def _middle_azimuth(area: Area) -> float:
    mean = np.sum([cones.solid_angle(c) * c.mean(axis=0) for c in area.cones], axis=0) @ area.R.T
    return math.atan2(mean[0], mean[1])
