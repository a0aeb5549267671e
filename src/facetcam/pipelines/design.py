"""From a drawing to its report: what the rig sees, its best camera, how well it must be built."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from facetcam.config import from_mapping
from facetcam.design.analysis import Analysis, analyse
from facetcam.design.family import make_rig
from facetcam.design.optimal import OptimalCamera, best_camera, first_mirror, longest_focal, unfolded_ends
from facetcam.design.search import Found, search
from facetcam.design.spec import GOALS, DesignSpec, Goal, read_spec
from facetcam.design.tolerance import ToleranceReport, simulate_builds
from facetcam.errors import ConfigError, RigError
from facetcam.geometry import se3
from facetcam.io.outputs import atomic_write, fresh_folder, require_absent, writing
from facetcam.pipelines.progress import Progress, silent
from facetcam.pipelines.workshop import workshop_files
from facetcam.rig import Rig
from facetcam.viz.design_page import DesignReport, write_design_report

Stage = Callable[[str], AbstractContextManager[Progress]]
"""Opened with the name of each stage; gives what to call as it goes on."""


@dataclass(frozen=True, slots=True)
class Design:
    """The rig that was designed, what it sees, and where the files are."""

    spec: DesignSpec
    analysis: Analysis
    optimum: dict[str, OptimalCamera]
    tolerance: ToleranceReport | None
    found: Found | None
    out: Path

    @property
    def report(self) -> Path:
        """The page that shows the design."""
        return self.out / "report.html"


def unwatched(name: str) -> AbstractContextManager[Progress]:
    """Open a stage that nobody watches."""
    return nullcontext(silent)


def run_design(
    source: Path | str,
    out: Path | str,
    *,
    search_best: bool = False,
    goal: str | None = None,
    tolerance: bool = True,
    make: bool = False,
    seed: int = 0,
    stage: Stage = unwatched,
) -> Design:
    """Design a rig: write `rig.yaml`, `design.yaml`, `design.json` and `report.html`.

    Parameters
    ----------
    source : path or str
        A design file, a `rig.yaml`, or `preset:NAME`; see `facetcam.design.read_spec`.
    out : path
        Folder to make.
    search_best : bool
        Look for the best parameters first, within the design's bounds and envelope.
    goal : str, optional
        What the search maximises, as in `coverage` or `coverage=1,baseline=0.5`; replaces the design's.
    tolerance : bool
        Simulate builds with errors.
    make : bool
        Also write `make/`: templates to cut (SVG, DXF), a bill of parts, a holder to print (STL).
    seed : int
        Of the search and of the build errors.
    stage : callable
        Opens a progress bar for each stage.

    Raises
    ------
    FacetcamError
        Before `out` is made, if the design cannot be.
    """
    require_absent(out)
    spec = read_spec(source)
    if goal is not None:
        spec = replace(spec, search=replace(spec.search, goal=parse_goal(goal)))
    found = None
    if search_best:
        with stage("searching") as progress:
            found = search(spec, seed, progress)
        spec = found.spec
    rig = make_rig(spec)
    analysis = analyse(rig, spec.body, spec.optics)
    builds = None
    if tolerance:
        with stage("building with errors") as progress:
            builds = simulate_builds(rig, spec.tolerance, seed, spec.body, progress)
    workshop = workshop_files(rig, spec) if make else {}
    folder = fresh_folder(out)
    design = Design(spec, analysis, best_cameras(rig, spec), builds, found, folder)
    write_design(design, Path(source).stem.replace("preset:", ""), workshop)
    return design


def best_cameras(rig: Rig, spec: DesignSpec) -> dict[str, OptimalCamera]:
    """Longest focal lengths that show all of the first mirrors, or at least all that ends a view."""
    try:
        target = first_mirror(rig)
        here = longest_focal(rig.camera, se3.transform(se3.inverse(rig.T_rig_cam), target))
    except RigError:
        return {}
    found = {
        "all of the first mirror, as it stands": OptimalCamera(here, rig.T_rig_cam),
        "all of the first mirror, turned at will": best_camera(rig.camera, target, rig.T_rig_cam),
    }
    ends = unfolded_ends(rig)
    if len(ends):
        found["all facets, turned at will"] = best_camera(rig.camera, ends, rig.T_rig_cam)
    if spec.family is not None and spec.family.fold:
        top = rig.T_rig_cam.copy()
        top[2, 3] = spec.family.height
        found["first mirror, camera at the top plane"] = best_camera(rig.camera, target, top)
        low, high = rig.T_rig_cam[:3, 3].copy(), rig.T_rig_cam[:3, 3].copy()
        low[:2], high[:2] = -spec.family.radius / 2, spec.family.radius / 2
        words = "first mirror, turned and up to half the radius off the axis"
        found[words] = best_camera(rig.camera, target, rig.T_rig_cam, (low, high))
    return found


def parse_goal(text: str) -> Goal:
    """`coverage`, or `coverage=1,baseline=0.5`, as weights."""
    weights = dict.fromkeys(GOALS, 0.0)
    for part in text.split(","):
        name, _, weight = part.strip().partition("=")
        if name not in weights:
            raise ConfigError(f"goal: {name!r} is not one of {', '.join(GOALS)}")
        try:
            weights[name] = float(weight or 1.0)
        except ValueError:
            raise ConfigError(f"goal: the weight {weight!r} of {name} is not a number") from None
    return from_mapping(Goal, weights, "goal")


def write_design(design: Design, name: str, workshop: dict[str, bytes]) -> None:
    """Write all files of a design into its folder."""
    rig, folder = design.analysis.rig, design.out
    rig.save(folder / "rig.yaml")
    files = [
        ("rig.yaml", "the rig, for every command that takes --rig"),
        ("design.json", "the numbers of this page"),
    ]
    if design.spec.family is not None:
        atomic_write(folder / "design.yaml", design_yaml(design.spec))
        files.insert(1, ("design.yaml", "the drawing, to be changed and designed again"))
    atomic_write(folder / "design.json", json.dumps(numbers(design), indent=2, allow_nan=False) + "\n")
    if workshop:
        with writing(folder / "make"):
            (folder / "make").mkdir()
        for file, data in workshop.items():
            atomic_write(folder / "make" / file, data)
        files.append(("make/", f"{', '.join(workshop)}: to cut and to print, in millimetres"))
    title = design.spec.title or name
    report = DesignReport(
        title, design.spec, design.analysis, design.optimum, design.tolerance, design.found, files
    )
    write_design_report(report, design.report)


def design_yaml(spec: DesignSpec) -> str:
    """The design as a file that `read_spec` reads."""
    content = {key: value for key, value in _plain(spec).items() if value is not None}
    return yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=110)


def numbers(design: Design) -> dict[str, Any]:
    """The numbers of the page as plain values: metres, radians, pixels, steradians."""
    analysis = design.analysis
    return {
        "horizon_share": analysis.horizon,
        "sphere_share": analysis.sphere,
        "overlap_share": analysis.overlap,
        "centres_spread": analysis.spread,
        "centres_spread_rms": analysis.spread_rms,
        "dead_pixels": analysis.sensor.dead(),
        "parasites": analysis.sensor.parasites,
        "views": {name: _plain(view) for name, view in analysis.views.items()},
        "wedges": [
            {"views": w.views, "beta": w.beta, "angle": [w.angle.min(), w.angle.max()], "blind": w.blind}
            for w in analysis.wedges
        ],
        "seams": [_plain(seam) for seam in analysis.seams],
        "longest_focal": {words: camera.focal for words, camera in design.optimum.items()},
        "tolerance": None
        if design.tolerance is None
        else {
            "removed": dict(zip(design.tolerance.views, design.tolerance.removed.tolist())),
            "before_rms": dict(
                zip(design.tolerance.views, np.sqrt((design.tolerance.before**2).mean(0)).tolist())
            ),
            "after_rms": dict(
                zip(design.tolerance.views, np.sqrt((design.tolerance.after**2).mean(0)).tolist())
            ),
        },
        "search": None
        if design.found is None
        else {
            "best": _plain(design.found.best),
            "start": _plain(design.found.start),
            "evaluations": design.found.evaluations,
        },
    }


def _plain(value: Any) -> Any:
    """Dataclasses, arrays and numbers as what JSON and YAML know; what is not finite becomes None."""
    if hasattr(value, "__dataclass_fields__"):
        return {key: _plain(getattr(value, key)) for key in value.__dataclass_fields__}
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [_plain(item) for item in value]
    if isinstance(value, (float, np.floating)):
        return float(value) if math.isfinite(value) else None
    return value
