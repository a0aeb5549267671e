"""From photos of boards to a rig as built, with how good it is."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from facetcam.calibration.boards import BoardSet
from facetcam.calibration.quality import Validation
from facetcam.calibration.result import Calibration, Preflight
from facetcam.calibration.sightings import Sighting
from facetcam.errors import FacetcamError
from facetcam.io.outputs import atomic_write, fresh_folder, require_absent
from facetcam.pipelines.calibrate_inputs import Images, Seen, look, telling
from facetcam.pipelines.calibrate_results import summarise, write_report, write_rig
from facetcam.pipelines.demo import Stage, unwatched
from facetcam.pipelines.photo_memory import Photo
from facetcam.pipelines.photos import SecondLook
from facetcam.pipelines.progress import keeping
from facetcam.pipelines.summary import to_json
from facetcam.rig import Rig


@dataclass(frozen=True, eq=False)
class Calibrated:
    """What `run_calibration` found.

    Attributes
    ----------
    calibration : Calibration
    validation : Validation or None
        None when it was not asked for, or with the reason in `warnings` when there are too few photos.
    photos : tuple of Photo
        Those that took part; their order gives the indices in the calibration.
    folder : Path
        rig.yaml, report.html, residuals.csv, summary.json, export/
    warnings : tuple of str
    """

    calibration: Calibration
    validation: Validation | None
    photos: tuple[Photo, ...]
    folder: Path
    warnings: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Checked:
    """What `run_check` found."""

    preflight: Preflight
    seen: Seen

    @property
    def warnings(self) -> tuple[str, ...]:
        """What was not as it should be."""
        return (*self.seen.warnings, *(finding.text for finding in self.preflight.findings))

    def rows(self) -> list[tuple[str, str]]:
        """The check in a few lines: what is seen, what can be known, what to add."""
        names = [board.name for board in self.seen.boards.boards]
        count = [sum(s.board == i for s in self.seen.sightings) for i in range(len(names))]
        found = self.preflight
        return [
            ("photos", str(len(self.seen.photos))),
            ("sightings a board", ", ".join(f"{name} {n}" for name, n in zip(names, count))),
            ("sightings a view", ", ".join(f"{view} {n}" for view, n in found.sightings.items())),
            ("enough", "yes" if found.enough else "no"),
            *(("expected sigma", f"{name}: {sigma}") for name, sigma in found.expected.items()),
            *(("cannot be known", unknown.what) for unknown in found.unobservable),
            *(("what helps", advice) for advice in found.advice),
        ]


def run_calibration(
    images: Images,
    boards: BoardSet | Path | str,
    out: Path | str,
    *,
    rig: Rig | Path | str | None = None,
    camera: Path | str | None = None,
    holdout: bool = True,
    cache: Path | str | None = None,
    stage: Stage = unwatched,
) -> Calibrated:
    """Calibrate a rig from photos of boards and write rig.yaml, report.html, residuals, summary and exports.

    Parameters
    ----------
    images : path or sequence of paths
        A folder of photos, or the photos.
    boards : BoardSet or path
        The `boards.yaml`.
    out : path
        Folder to make.
    rig : Rig or path, optional
        As drawn. Without it the views, direct and through single mirrors, are found from the photos.
    camera : path, optional
        Intrinsics to begin with (OpenCV YAML or Kalibr camchain) in place of the drawing's.
    holdout : bool
        Judge the result on photos left out, and by halves of the set; takes several solves more.
    cache : path, optional
        Folder for what was found in the photos (default: the user's cache), so that a run cut short, or
        another solve, begins where they were.
    stage : callable
        Opens a progress bar for each stage.

    Raises
    ------
    FacetcamError
        If the photos, the boards or the rig cannot be used, or nothing can be solved.
    """
    require_absent(out)
    seen = look(images, boards, out, rig=rig, camera=camera, cache=cache, stage=stage)
    second = SecondLook(seen.photos)
    with telling(seen.warnings):
        calibration = solved(seen, second, stage)
    folder = fresh_folder(out)
    validation: Validation | None = None
    warnings = list(seen.warnings)

    def cut_short(reason: str) -> None:
        """What takes no time: a page does."""
        told = [*warnings, f"cut short before the report was written: {reason}"]
        summary = summarise(calibration, validation, seen.photos, told)
        atomic_write(folder / "summary.json", to_json(summary))

    with keeping(folder, cut_short):
        write_rig(calibration, seen.photos, folder)
        if holdout:
            validation = judged(calibration, second, stage, warnings)
        with stage("writing"):
            drawn = seen.rig is not None
            write_report(calibration, validation, seen.photos, second, folder, warnings, drawn)
    return Calibrated(calibration, validation, seen.photos, folder, tuple(warnings))


def solved(seen: Seen, second: SecondLook, stage: Stage) -> Calibration:
    """The joint solve, from the drawing, or from the photos alone."""
    from facetcam.calibration.scale import refuse_far_scale, wrong_scale
    from facetcam.calibration.solve import solve

    if seen.rig is None:
        return _from_photos(seen, second, stage)
    with stage("solving") as progress:
        found = solve(seen.rig, seen.boards, seen.sightings, second, progress)
    refuse_far_scale(found.fit, seen.boards)
    return replace(found, findings=(*found.findings, *wrong_scale(found.fit, seen.boards)))


def _from_photos(seen: Seen, second: SecondLook, stage: Stage) -> Calibration:
    """Without a drawing: mirrors and views first, then all that they let one find, then their glass."""
    from facetcam.calibration.completion import completed, find_glass, glazed
    from facetcam.calibration.solve import solve

    rig, sightings = begun(seen, stage)
    with stage("solving for the views found") as progress:
        first = solve(rig, seen.boards, sightings, None, progress)
    with stage("looking for the board in all views"):
        rig, sightings = completed(first, second)
    with stage("solving") as progress:
        calibration = solve(rig, seen.boards, sightings, None, progress)
    with stage("measuring the glass of the mirrors"):
        glass = find_glass(calibration.fit)
    if glass.thickness < 3.0 * glass.sigma:
        return calibration
    with stage("solving with glass") as progress:
        return solve(glazed(calibration.rig, glass.thickness), seen.boards, sightings, None, progress)


def begun(seen: Seen, stage: Stage) -> tuple[Rig, list[Sighting]]:
    """The drawing; without one, a rig found from the photos, and sightings that know their views."""
    if seen.rig is not None:
        return seen.rig, seen.sightings
    from facetcam.calibration.bootstrap import bootstrap

    with stage("finding mirrors"):
        return bootstrap(seen.boards, seen.sightings, seen.photos[0].size)


def judged(
    calibration: Calibration, second: SecondLook, stage: Stage, warnings: list[str]
) -> Validation | None:
    """How good the result is; None, with a warning, where the photos are too few to tell."""
    from facetcam.calibration.validation import validate

    with stage("judging") as progress:
        try:
            return validate(calibration, progress=progress)
        except FacetcamError as error:
            warnings.append(f"the result could not be judged: {error}")
            return None


def run_check(
    images: Images,
    boards: BoardSet | Path | str,
    out: Path | str,
    *,
    rig: Rig | Path | str | None = None,
    camera: Path | str | None = None,
    cache: Path | str | None = None,
    stage: Stage = unwatched,
) -> Checked:
    """Tell before the solve what the photos can determine and which to add; see `run_calibration`."""
    from facetcam.calibration.preflight import preflight

    seen = look(images, boards, out, rig=rig, camera=camera, cache=cache, stage=stage)
    with telling(seen.warnings):
        nominal, sightings = begun(seen, stage)
    with telling(seen.warnings), stage("checking"):
        return Checked(preflight(nominal, seen.boards, sightings), seen)
