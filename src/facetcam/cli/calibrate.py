"""`facetcam calibrate`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from facetcam.cli.failures import warn
from facetcam.cli.options import OutOption, output_folder
from facetcam.cli.progress import prompt_bar
from facetcam.cli.tables import print_pairs

if TYPE_CHECKING:
    from facetcam.pipelines.calibrate import Calibrated
    from facetcam.pipelines.hand_mirror import Placed


def calibrate(
    images: Annotated[Path, typer.Argument(metavar="IMAGES", help="Folder of photos of the boards.")],
    boards: Annotated[Path, typer.Option(help="boards.yaml of what is seen, as `facetcam boards` makes it.")],
    rig: Annotated[
        Path | None, typer.Option(help="rig.yaml as drawn (default: find the views from the photos).")
    ] = None,
    camera: Annotated[
        Path | None, typer.Option(help="Intrinsics to begin with: OpenCV YAML or Kalibr camchain.")
    ] = None,
    out: OutOption = None,
    check: Annotated[
        bool, typer.Option("--check", help="Only tell what the photos can determine and which to add.")
    ] = False,
    hand_mirror: Annotated[
        bool,
        typer.Option(
            "--hand-mirror",
            help="Where a board stands that only a mirror held by hand shows; needs --camera.",
        ),
    ] = False,
    holdout: Annotated[
        bool, typer.Option("--holdout/--no-holdout", help="Judge on photos left out, and on halves.")
    ] = True,
    cache: Annotated[
        Path | None, typer.Option(help="Folder for what was found in photos (default: the user's cache).")
    ] = None,
) -> None:
    """Calibrate a rig from photos of boards: rig.yaml and a report."""
    folder = output_folder(out, f"{images.resolve().name}-rig")
    if hand_mirror:
        _hand_mirror(images, boards, folder, camera, rig, check, cache)
        return
    from facetcam.pipelines.calibrate import run_calibration, run_check

    if check:
        run = run_check(images, boards, folder, rig=rig, camera=camera, cache=cache, stage=prompt_bar)
        for warning in run.warnings:
            warn(warning)
        print_pairs("check", run.rows())
        raise typer.Exit(0 if run.preflight.enough else 1)
    result = run_calibration(
        images,
        boards,
        folder,
        rig=rig,
        camera=camera,
        holdout=holdout,
        cache=cache,
        stage=prompt_bar,
    )
    for warning in result.warnings:
        warn(warning)
    names = [photo.path.name for photo in result.photos]
    for finding in result.calibration.findings:
        warn(finding.told(names))
    print_pairs("calibrate", rows_of(result))


def _hand_mirror(
    images: Path,
    boards: Path,
    out: Path,
    camera: Path | None,
    rig: Path | None,
    check: bool,
    cache: Path | None,
) -> None:
    """Place a board that is seen in a moving mirror."""
    if rig is not None or check:
        raise typer.BadParameter("takes neither --rig nor --check", param_hint="'--hand-mirror'")
    if camera is None:
        hint = "needs --camera: focal length and principal point cannot come from such photos"
        raise typer.BadParameter(hint, param_hint="'--hand-mirror'")
    from facetcam.pipelines.hand_mirror import run_hand_mirror

    placed = run_hand_mirror(images, boards, out, camera, cache=cache, stage=prompt_bar)
    for warning in placed.summary.warnings:
        warn(warning)
    print_pairs("calibrate", hand_mirror_rows(placed))


def hand_mirror_rows(placed: Placed) -> list[tuple[str, str]]:
    """The board's place in a few lines."""
    s = placed.summary
    known = (
        f"{s.sigma_deg:.3f} degrees, {s.sigma_mm:.2f} mm (one sigma)" if s.sigma_deg == s.sigma_deg else "?"
    )
    return [
        ("poses of the mirror", str(len(s.photos))),
        ("board", f"{1000 * s.distance:.1f} mm away"),
        ("known to", known),
        ("residual", f"{s.rms:.3f} px RMS; each image by itself {s.rms_apart:.3f}"),
        ("T_cam_board", str(placed.folder / "summary.json")),
        ("report", str(placed.folder / "report.html")),
    ]


def rows_of(result: Calibrated) -> list[tuple[str, str]]:
    """The run in a few lines."""
    calibration, validation = result.calibration, result.validation
    rows = [
        (
            "photos, sightings",
            f"{len({f.sighting.photo for f in calibration.sightings})}, {len(calibration.sightings)}",
        ),
        ("residual", f"{calibration.rms():.3f} px RMS of the corners kept"),
    ]
    if validation is not None:
        across = f", {validation.cross_view_expected:.3f} by the sigmas"
        judged = [
            ("held-out photos", validation.held_out_rms, ""),
            ("from one view to the others", validation.cross_view_rms, across),
            ("between two halves", validation.split_half_rms, ""),
        ]
        rows += [(label, f"{value:.3f} px RMS{more}") for label, value, more in judged if value == value]
    found = zip(calibration.parameters.names, calibration.parameters.value, calibration.parameters.sigma)
    rows += [
        ("glass of " + name.removesuffix(": thickness"), f"{value:.2f} +- {sigma:.2f} mm thick")
        for name, value, sigma in found
        if name.endswith(": thickness")
    ]
    rows += [("not determined", unknown.what) for unknown in calibration.unobservable if not unknown.harmless]
    return [*rows, ("rig", str(result.folder / "rig.yaml")), ("report", str(result.folder / "report.html"))]
