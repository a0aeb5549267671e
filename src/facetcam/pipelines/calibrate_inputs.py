"""Reading the inputs of a calibration, and sorting its photos, before anything is solved."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from facetcam.calibration.board_files import read_boards
from facetcam.calibration.boards import BoardSet
from facetcam.calibration.sightings import Sighting
from facetcam.errors import FacetcamError, OutputError
from facetcam.io.intrinsics import read_intrinsics
from facetcam.pipelines.demo import Stage, unwatched
from facetcam.pipelines.photo_checks import fit_together, require_boards, require_motion
from facetcam.pipelines.photo_memory import Photo, default_cache
from facetcam.pipelines.photos import look_at_photos, passed_over, photo_paths
from facetcam.rig import Camera, Rig

_SMALLEST, _LARGEST = 0.01, 4.0  # metres; boards of rooms lie between

Images = Path | str | Sequence[Path | str]


@dataclass(frozen=True, eq=False)
class Seen:
    """Photos that were looked at and belong together, and what they are to be solved with."""

    photos: tuple[Photo, ...]
    boards: BoardSet
    rig: Rig | None
    warnings: tuple[str, ...]

    @property
    def sightings(self) -> list[Sighting]:
        """Of all photos."""
        return [s for photo in self.photos for s in photo.sightings]


def look(
    images: Images,
    boards: BoardSet | Path | str,
    out: Path | str,
    *,
    rig: Rig | Path | str | None = None,
    camera: Path | str | None = None,
    cache: Path | str | None = None,
    stage: Stage = unwatched,
) -> Seen:
    """Read everything, find the boards in the photos, and leave out photos that do not belong.

    Raises
    ------
    FacetcamError
        As `run_calibration`; what was seen is saved beside `out` when no board was found.
    """
    chosen = boards if isinstance(boards, BoardSet) else read_boards(boards)
    nominal = rig if isinstance(rig, Rig) or rig is None else Rig.load(rig)
    paths = photo_paths(images)
    if camera is not None:
        if nominal is None:
            raise FacetcamError(
                f"{camera}: intrinsics are taken up only with a rig as drawn; give it, or leave them out"
            )
        nominal = with_lens(nominal, read_intrinsics(camera))
    kept, warnings = looked(paths, chosen, out, nominal.size if nominal is not None else None, cache, stage)
    warnings = (*passed_over(images), *oversized(chosen), *warnings)
    with telling(warnings):
        require_motion(kept)
    return Seen(tuple(kept), chosen, nominal, warnings)


def oversized(boards: BoardSet) -> list[str]:
    """Boards too large or too small to be meant, as when squares are told in other units than metres."""
    alike: dict[tuple[str, str], list[str]] = {}
    for board in boards.boards:
        if not _SMALLEST < max(board.size) < _LARGEST:
            size = f"{max(board.size):.3g}", f"{board.square:g}"
            alike.setdefault(size, []).append(f"'{board.name}'")
    return [
        f"board{'s' if len(names) > 1 else ''} {', '.join(names)} would be {width} m wide:"
        f" {'their' if len(names) > 1 else 'its'} square, {square}, is in metres"
        for (width, square), names in alike.items()
    ]


def looked(
    paths: Sequence[Path],
    boards: BoardSet,
    out: Path | str,
    size: tuple[int, int] | None,
    cache: Path | str | None,
    stage: Stage,
) -> tuple[list[Photo], tuple[str, ...]]:
    """Photos of a size that belong together, with the boards in them, and why others were left out."""
    remembered = Path(cache) if cache is not None else default_cache()
    if Path(out).resolve() in (remembered.resolve(), *remembered.resolve().parents):
        raise OutputError(
            f"{remembered}: lies in the folder of the results, which must be new; name another --cache"
        )
    with stage("looking for boards") as progress, telling():
        photos, unreadable = look_at_photos(paths, boards, remembered, progress)
    kept, left_out = fit_together(photos, size)
    warnings = (*unreadable, *left_out)
    with telling(warnings):
        require_boards(kept, boards, out)
    return kept, warnings


@contextmanager
def telling(warnings: Sequence[str] = ()) -> Iterator[None]:
    """Let a failure also tell which photos were left out, as that may be its cause; a stop, what is kept."""
    try:
        yield
    except KeyboardInterrupt as error:
        error.add_note("what was found so far in the photos is kept, the same command goes on from there")
        raise
    except FacetcamError as error:
        for warning in warnings:
            error.add_note(warning)
        raise


def with_lens(rig: Rig, lens: Camera) -> Rig:
    """The rig with intrinsics measured elsewhere.

    Raises
    ------
    FacetcamError
        If they belong to another size of image.
    """
    if (lens.width, lens.height) != rig.size:
        raise FacetcamError(
            f"camera: the intrinsics are of {lens.width}x{lens.height} images, the rig has"
            f" {rig.size[0]}x{rig.size[1]}; intrinsics belong to one size"
        )
    return Rig(lens, rig.T_rig_cam, rig.mirrors, rig.views)
