"""From a film to upright, un-mirrored views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import cv2

from facetcam.errors import OutputError
from facetcam.io.frames import Frame
from facetcam.io.outputs import atomic_write, fresh_folder, require_absent, writing
from facetcam.io.sources import Source, open_source
from facetcam.pipelines.inputs import require_size
from facetcam.pipelines.pictures import EvenSample
from facetcam.pipelines.progress import Progress, keeping, silent, total_frames
from facetcam.rig import Rig
from facetcam.unwrapping import Panorama, Unwrapper, unwrap, write_views
from facetcam.viz.pages import write_unwrap_report
from facetcam.viz.report import Picture, UnwrapReport

SHEET_ROWS = 4
PANORAMA = "panorama"


@dataclass(frozen=True, slots=True)
class Unwrapped:
    """Number of frames unwrapped, the contact sheet, and what was not as it should be."""

    frames: int
    report: Path
    warnings: tuple[str, ...]


def run_unwrap(
    source: Path | str | int,
    rig_path: Path | str,
    out: Path | str,
    *,
    size: tuple[int, int] | None = None,
    fov: float | None = None,
    views: Sequence[str] | None = None,
    panorama_depth: float | None = None,
    max_frames: int | None = None,
    progress: Progress = silent,
) -> Unwrapped:
    """Unwrap every frame: `VIEW/000000.png`, ..., `views.yaml` and a contact sheet `report.html`.

    Parameters
    ----------
    source : path or int
        Film, folder of images, or number of a live camera.
    rig_path : path
        The `rig.yaml` of the film.
    out : path
        Folder to make.
    size, fov, views
        Width and height (pixels), horizontal field of view (rad) and names; see `facetcam.unwrapping.unwrap`.
    panorama_depth : float, optional
        Also write `panorama/000000.png`, ..., right at this depth in metres.
    max_frames : int, optional
        Stop after so many frames.
    progress : callable
        See `facetcam.pipelines.Progress`.

    Raises
    ------
    FacetcamError
        Before `out` is made, if an input is wrong; later, if the film is damaged or the disk is full.
    """
    require_absent(out)
    rig = Rig.load(rig_path)
    require_folder_names(rig.view_names)
    unwrapper = unwrap(rig, size, fov, views)
    panorama = Panorama(rig, panorama_depth) if panorama_depth is not None else None
    film = open_source(source, timed=False)
    require_size(film, rig)
    with film:
        record = ViewRecord(fresh_folder(out), unwrapper, panorama)
        with keeping(record.folder, lambda reason: record.finish(film, reason)):
            for frame in islice(film, max_frames):
                record.add(frame)
                progress(record.frames, total_frames(film.count, max_frames))
            return record.finish(film)


class ViewRecord:
    """The folder of a run: unwraps and writes frame by frame, and keeps a few for the contact sheet."""

    def __init__(self, folder: Path, unwrapper: Unwrapper, panorama: Panorama | None) -> None:
        self.folder = folder
        self.frames = 0
        self._unwrapper = unwrapper
        self._panorama = panorama
        self._sheet: EvenSample[list[Picture]] = EvenSample(SHEET_ROWS)
        write_views(unwrapper.views.values(), folder / "views.yaml")
        for name in (*unwrapper.views, *([PANORAMA] if panorama else [])):
            with writing(folder / name):
                (folder / name).mkdir()

    def add(self, frame: Frame) -> None:
        """Unwrap a frame and write its pictures."""
        pictures = self._unwrapper(frame.image)
        if self._panorama is not None:
            pictures[PANORAMA] = self._panorama(frame.image)
        for name, picture in pictures.items():
            atomic_write(
                self.folder / name / f"{frame.index:06d}.png", cv2.imencode(".png", picture)[1].tobytes()
            )
        self._sheet.offer(lambda: [Picture(f"{frame.name}, {name}", p) for name, p in pictures.items()])
        self.frames += 1

    def finish(self, film: Source, interrupted: str = "") -> Unwrapped:
        """Write the contact sheet."""
        title = f"Views of {Path(film.name).name}"
        facts = {"frames": str(self.frames)}
        report = UnwrapReport(title, self._sheet.items(), interrupted, facts)
        write_unwrap_report(report, self.folder / "report.html")
        return Unwrapped(self.frames, self.folder / "report.html", film.warnings)


def require_folder_names(names: Sequence[str]) -> None:
    """Raise OutputError unless each view's name can name a folder of its own."""
    for name in names:
        if Path(name).name != name or name in (PANORAMA, "views.yaml", "report.html"):
            raise OutputError(f"view {name!r}: cannot name a folder of pictures; rename it in the rig")
