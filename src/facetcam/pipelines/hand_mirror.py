"""From photos of a board that is seen only in a mirror held by hand to where it stands before the camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from facetcam.calibration.board_files import read_boards
from facetcam.calibration.boards import Board, BoardSet
from facetcam.calibration.fit import Fit
from facetcam.calibration.hand_mirror import HandMirror, solve_hand_mirror
from facetcam.calibration.hand_mirror_checks import Sigma, rms_apart, sigma_of
from facetcam.calibration.result import FittedSighting
from facetcam.calibration.sightings import Sighting
from facetcam.errors import FacetcamError
from facetcam.geometry import se3
from facetcam.io.intrinsics import read_intrinsics
from facetcam.io.outputs import atomic_write, fresh_folder, require_absent
from facetcam.io.virtual_cameras import opencv_camera
from facetcam.pipelines.calibrate_inputs import Images, looked, oversized, telling
from facetcam.pipelines.calibrate_results import residuals_csv
from facetcam.pipelines.demo import Stage, unwatched
from facetcam.pipelines.photo_memory import Photo
from facetcam.pipelines.photos import SecondLook, passed_over, photo_paths
from facetcam.pipelines.summary import to_json
from facetcam.rig import Camera, Rig, View
from facetcam.viz.hand_mirror_page import HandMirrorReport, write_hand_mirror_report
from facetcam.viz.report import Picture

Array = NDArray[np.float64]

_PICTURES = 6
_UNEXPLAINED = 1.6  # times the residual of each image by itself
_FREE = 0.3  # pixels of it that nobody minds


@dataclass(frozen=True, slots=True)
class HandMirrorSummary:
    """Numbers of a board in a hand-held mirror, as written to `summary.json`; None where unknown.

    `T_cam_board` maps the board's frame (origin in its upper left corner, x right, y down) to the camera's;
    `sigma_deg` and `sigma_mm` are of its turn and of its middle.
    """

    photos: tuple[str, ...]
    T_cam_board: list[list[float]]
    distance: float
    sigma_deg: float
    sigma_mm: float
    rms: float
    rms_by_photo: tuple[float, ...]
    rms_apart: float
    distortion: tuple[float, ...]
    warnings: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Placed:
    """What `run_hand_mirror` found: `photos` are those that took part, in the order of the mirror's poses."""

    board: Board
    photos: tuple[Photo, ...]
    found: HandMirror
    sigma: Sigma
    rms_apart: Array
    summary: HandMirrorSummary
    folder: Path


def run_hand_mirror(
    images: Images,
    boards: BoardSet | Path | str,
    out: Path | str,
    camera: Camera | Path | str,
    *,
    cache: Path | str | None = None,
    stage: Stage = unwatched,
) -> Placed:
    """Find where a board stands that the camera sees only in a mirror held in three or more poses.

    Parameters
    ----------
    images : path or sequence of paths
        Photos; between them camera and board stand still and the mirror is moved.
    boards : BoardSet or path
        The `boards.yaml` with the one board.
    out : path
        Folder to make: `summary.json`, `camera.yaml` (with the distortion found), `residuals.csv`,
        `report.html`.
    camera : Camera or path
        Its intrinsics; focal length and principal point are kept, k1 and k2 are estimated.
    cache : path, optional
        As for `run_calibration`.
    stage : callable
        Opens a progress bar for each stage.

    Raises
    ------
    FacetcamError
        If the inputs cannot be used, or the photos do not fix the board's place.
    """
    require_absent(out)
    set_ = boards if isinstance(boards, BoardSet) else read_boards(boards)
    if len(set_.boards) != 1:
        raise FacetcamError(
            f"hand-held mirror: boards.yaml describes {len(set_.boards)} boards; keep the one that is seen"
        )
    lens = camera if isinstance(camera, Camera) else read_intrinsics(camera)
    size = lens.width, lens.height
    photos, said = looked(photo_paths(images), set_, out, size, cache, stage)
    said = (*passed_over(images), *oversized(set_), *said)
    board, warnings = set_.boards[0], [*said]
    photos, sightings = _in_the_mirror(photos, warnings)
    with telling(said), stage("solving"):
        found = solve_hand_mirror(board, sightings, lens)
    with stage("judging") as progress:
        sigma = sigma_of(found, board, lens, progress)
    apart = rms_apart(found)
    summary = _summarised(found, sigma, apart, board, photos, warnings)
    with stage("writing"):
        folder = fresh_folder(out)
        placed = Placed(board, tuple(photos), found, sigma, apart, summary, folder)
        _write(placed)
    return placed


def _in_the_mirror(photos: Sequence[Photo], warnings: list[str]) -> tuple[list[Photo], list[Sighting]]:
    """The sighting of each photo that is a mirror image, or may be; photos without one are left out."""
    kept, sightings, direct = list[Photo](), list[Sighting](), list[str]()
    for photo in photos:
        mirrored = [s for s in photo.sightings if s.mirrored is not False]
        if mirrored:
            kept.append(photo)
            sightings.append(max(mirrored, key=len))
        elif photo.sightings:
            direct.append(photo.path.name)
    if direct:
        warnings.append(f"left out, the board is seen directly, not in a mirror: {', '.join(direct[:5])}")
    if not sightings:
        raise FacetcamError(
            "hand-held mirror: all photos show the board directly; turn the camera away from it, and hold the"
            " mirror so that it shows the board"
        )
    return kept, sightings


def _summarised(
    found: HandMirror,
    sigma: Sigma,
    apart: Array,
    board: Board,
    photos: Sequence[Photo],
    warnings: Sequence[str],
) -> HandMirrorSummary:
    together = found.pose_rms
    said = list(warnings)
    free = float(np.sqrt(np.nanmean(apart**2)))
    if found.rms > _UNEXPLAINED * free + _FREE:
        worst = photos[int(np.nanargmax(together - apart))].path.name
        said.append(
            f"no fixed board explains the photos: {found.rms:.2f} px, but {free:.2f} px when each image may"
            f" stand where it likes, most so in {worst}; did camera or board move, or is the mirror not flat?"
        )
    if np.isnan(sigma.turn):
        said.append("how well the place is known cannot be told; four or more poses of the mirror tell it")
    middle = se3.transform(found.T_cam_board, np.array([[*board.size, 0.0]]) / 2)[0]
    return HandMirrorSummary(
        photos=tuple(photo.path.name for photo in photos),
        T_cam_board=found.T_cam_board.tolist(),
        distance=float(np.linalg.norm(middle)),
        sigma_deg=float(np.degrees(sigma.turn)),
        sigma_mm=1000.0 * sigma.shift,
        rms=found.rms,
        rms_by_photo=tuple(together.tolist()),
        rms_apart=free,
        distortion=found.rig.camera.distortion,
        warnings=tuple(said),
    )


def _write(placed: Placed) -> None:
    folder, found, photos, fit = placed.folder, placed.found, placed.photos, placed.found.fit
    atomic_write(folder / "summary.json", to_json(placed.summary))
    alone = Rig(found.rig.camera, np.eye(4), {}, {"direct": View(())})
    atomic_write(folder / "camera.yaml", opencv_camera(alone, "direct"))
    atomic_write(folder / "residuals.csv", residuals_csv(_fitted(fit), BoardSet((placed.board,)), photos))
    second = SecondLook(photos)
    spread = np.unique(np.linspace(0, len(photos) - 1, _PICTURES).round().astype(int)).tolist()
    pictures = [
        Picture(photos[i].path.name, second.image(i), s.pixels, np.full(len(s), i))
        for i, s in ((i, fit.sightings[i]) for i in spread)
    ]
    report = HandMirrorReport(
        title=f"Board '{placed.board.name}' in a mirror, from {len(photos)} photos",
        found=found,
        sigma=placed.sigma,
        distance=placed.summary.distance,
        rms_apart=placed.rms_apart,
        photos=placed.summary.photos,
        pictures=pictures,
        warnings=placed.summary.warnings,
    )
    write_hand_mirror_report(report, folder / "report.html")


def _fitted(fit: Fit) -> list[FittedSighting]:
    """Each photo's sighting, and how it is explained."""
    return [
        FittedSighting(replace(s, photo=index), s.pixels - fit.residuals[a:b], fit.kept[a:b])
        for index, (s, (a, b)) in enumerate(zip(fit.sightings, fit.looks.bounds))
    ]
