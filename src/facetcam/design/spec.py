"""What a user asks of a design: the drawing of a rig, its camera and lens, build errors, wishes."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from facetcam.config import from_mapping, read_yaml, require_ranges
from facetcam.errors import ConfigError, FacetcamError
from facetcam.rig import presets

GOALS = ("coverage", "resolution", "baseline", "overlap")


@dataclass(frozen=True, slots=True)
class Family:
    """Mirrors on a frustum (lengths in metres), as in the paper's Fig. 5.

    With `fold` the camera looks down on a base mirror that shows it the facets of an inverted frustum above.
    Without, it looks down on an upright pyramid.

    Attributes
    ----------
    faces : int
    radius : float
        From the axis to the line where the front facet meets the widest plane (the paper's top plane).
    tilt_degrees : float
        Between a facet and that plane.
    height : float
        From that plane to the base mirror; without fold, to the camera.
    depth : float or None
        How far a facet reaches inwards, measured in the plane; None: to the tip (only without fold).
    aspect : float
        Width of the outline by its length, front to back, for an even number of faces.
    camera_height : float
        Of the lens above the base mirror; only with fold.
    """

    fold: bool = True
    faces: int = 4
    radius: float = 0.0675
    tilt_degrees: float = 37.0
    height: float = 0.125
    depth: float | None = 0.06
    aspect: float = 4.0 / 3.0
    camera_height: float = 0.055

    @property
    def tilt(self) -> float:
        """Radians."""
        return math.radians(self.tilt_degrees)


@dataclass(frozen=True, slots=True)
class CameraSpec:
    """Sensor and lens; `focal` in pixels, None for the longest that shows all of the first mirrors."""

    width: int = 1600
    height: int = 1200
    focal: float | None = None
    model: Literal["brown-conrady", "kannala-brandt"] = "brown-conrady"
    distortion: tuple[float, ...] | None = None


@dataclass(frozen=True, slots=True)
class Optics:
    """Aperture (f-number), distance in focus (m) and pixel pitch (micrometres): what blurs the seams."""

    f_number: float = 2.0
    focus: float = 2.0
    pixel_um: float = 2.8

    def __post_init__(self) -> None:
        require_ranges("optics", self, f_number=(0.1, 1e4), focus=(1e-3, 1e6), pixel_um=(0.1, 1e3))


@dataclass(frozen=True, slots=True)
class Body:
    """The camera's body, a box behind the centre of its lens that may see itself (metres)."""

    width: float = 0.025
    height: float = 0.024
    depth: float = 0.02

    def __post_init__(self) -> None:
        require_ranges("body", self, width=(1e-4, 10.0), height=(1e-4, 10.0), depth=(1e-4, 10.0))


@dataclass(frozen=True, slots=True)
class Tolerance:
    """Standard deviations of build errors, and how calibration photographs measure them."""

    builds: int = 100
    tilt_arcmin: float = 10.0  # of each mirror, about two axes in its plane
    offset_mm: float = 0.2  # of each mirror along its normal
    cut_mm: float = 0.2  # of each edge in the plane of its mirror: moves seams, not points
    bow_um: float = 5.0  # of each mirror's middle over its edge: no plane model removes it
    camera_mm: float = 0.5  # along each axis
    camera_arcmin: float = 15.0  # about each axis
    noise_px: float = 0.1  # of an image point in calibration
    depths: tuple[float, ...] = (0.5, 1.0, 3.0)  # metres of the points behind the last mirror

    def __post_init__(self) -> None:
        require_ranges(
            "tolerance",
            self,
            builds=(2, 100_000),
            tilt_arcmin=(0.0, 600.0),
            offset_mm=(0.0, 100.0),
            cut_mm=(0.0, 100.0),
            bow_um=(0.0, 1e4),
            camera_mm=(0.0, 100.0),
            camera_arcmin=(0.0, 600.0),
            noise_px=(0.0, 100.0),
            depths=(0.01, 1e6),
        )
        if not self.depths:
            raise ConfigError("tolerance: depths take one or more distances in metres")


@dataclass(frozen=True, slots=True)
class Making:
    """How mirrors are made: thickness of the glass behind the reflecting surface, width of the cut."""

    thickness_mm: float = 2.0
    kerf_mm: float = 0.2

    def __post_init__(self) -> None:
        require_ranges("making", self, thickness_mm=(0.0, 50.0), kerf_mm=(0.0, 10.0))


@dataclass(frozen=True, slots=True)
class Bounds:
    """Range of each parameter that a search may change; equal ends, or none, keep it."""

    radius: tuple[float, float] | None = (0.03, 0.09)
    tilt_degrees: tuple[float, float] | None = (20.0, 60.0)
    height: tuple[float, float] | None = (0.05, 0.125)
    depth: tuple[float, float] | None = (0.01, 0.085)
    aspect: tuple[float, float] | None = (1.0, 1.5)
    camera_height: tuple[float, float] | None = (0.02, 0.12)
    focal: tuple[float, float] | None = None
    faces: tuple[int, int] | None = None


@dataclass(frozen=True, slots=True)
class Goal:
    """Weights of what a search maximises; each quantity is a share or stands to its unit (see `score`)."""

    coverage: float = 1.0
    resolution: float = 0.0
    baseline: float = 0.0
    overlap: float = 0.0

    def __post_init__(self) -> None:
        weights = [getattr(self, name) for name in GOALS]
        if min(weights) < 0 or max(weights) <= 0:
            raise ConfigError("goal: weights of zero or more, one of them above zero")


@dataclass(frozen=True, slots=True)
class Search:
    """Wish and limits: all mirrors must lie in the `envelope` (x, y, z in metres)."""

    goal: Goal = Goal()
    envelope: tuple[float, float, float] = (0.180, 0.135, 0.125)
    band_degrees: float = 10.0  # coverage counts elevations from minus to plus this
    bounds: Bounds = Bounds()
    generations: int = 40
    population: int = 12  # candidates a free parameter

    def __post_init__(self) -> None:
        counts = {"generations": (1, 10_000), "population": (1, 1_000)}
        require_ranges("search", self, **counts, envelope=(1e-3, 100.0), band_degrees=(0.1, 90.0))


@dataclass(frozen=True, slots=True)
class DesignSpec:
    """One design: a `family`, or any `rig` (a rig.yaml or preset:NAME)."""

    rig: str | None = None
    family: Family | None = None
    camera: CameraSpec = CameraSpec()
    optics: Optics = Optics()
    body: Body = Body()
    tolerance: Tolerance = Tolerance()
    search: Search = Search()
    making: Making = Making()
    title: str | None = None

    def __post_init__(self) -> None:
        if (self.rig is None) == (self.family is None):
            raise ConfigError("give either family (parameters) or rig (a rig.yaml or preset:NAME)")


def read_spec(source: Path | str) -> DesignSpec:
    """Read a design file; a `rig.yaml` or `preset:NAME` stands for a design with everything else by default.

    Raises
    ------
    ConfigError
        If the file cannot be read or does not fit.
    """
    if str(source).startswith(presets.PREFIX):
        if str(source) == f"{presets.PREFIX}ryu":  # the family's own defaults, with parameters to change
            return DesignSpec(family=Family(), camera=CameraSpec(focal=1250.0), title="ryu")
        return DesignSpec(rig=str(source))
    path = Path(source)
    content = read_yaml(path)
    if isinstance(content, dict) and "views" in content:
        return DesignSpec(rig=str(path))
    try:
        spec = from_mapping(DesignSpec, {} if content is None else content, str(path))
    except FacetcamError as error:
        raise ConfigError(str(error) if str(error).startswith(str(path)) else f"{path}: {error}") from None
    return _beside(spec, path)


def _beside(spec: DesignSpec, path: Path) -> DesignSpec:
    """A rig file is looked for beside the design that names it."""
    if spec.rig is None or spec.rig.startswith(presets.PREFIX):
        return spec
    return replace(spec, rig=str(path.parent / spec.rig))
