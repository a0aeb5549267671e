"""Which photos of a set belong together and are good enough, and what is wrong with the others."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path

import cv2
import numpy as np

from facetcam.calibration import diagnosis
from facetcam.calibration.boards import BoardSet
from facetcam.calibration.detection import to_grey
from facetcam.calibration.sharpness import sharpest_edges
from facetcam.errors import OutputError, SourceError
from facetcam.io.image_folder import read_image
from facetcam.io.outputs import atomic_write, writing
from facetcam.pipelines.photo_memory import Photo
from facetcam.pipelines.photos import Image
from facetcam.viz.wording import plural

BLURRED = 2.5  # times the usual width of edges
UNSHARP = 2.5  # pixels: photos of any scene that are in focus have edges up to 1.8 wide
SAME_POSE = 0.01  # of the photo's width that a board must move from photo to photo
_SAMPLES = 3  # photos that are looked at again to find out what is wrong


def fit_together(
    photos: Sequence[Photo], size: tuple[int, int] | None, rig_name: str = "the rig"
) -> tuple[list[Photo], list[str]]:
    """Keep the photos of one camera and size that are sharp, each once; say why the others are left out.

    Parameters
    ----------
    photos : sequence of Photo
    size : (int, int), optional
        Width and height that they must have; without it that of most.
    rig_name : str
        Where the size comes from, for messages.

    Returns
    -------
    photos : list of Photo
        With sightings numbered anew.
    warnings : list of str

    Raises
    ------
    SourceError
        If none has the size of the rig's camera.
    """
    kept, warnings = list(photos), list[str]()
    sizes = Counter(photo.size for photo in kept)
    wanted = size or sizes.most_common(1)[0][0]
    if wanted not in sizes:
        found = ", ".join(f"{w}x{h}" for w, h in sizes)
        raise SourceError(
            f"photos: they are {found}, but the camera of {rig_name} is {wanted[0]}x{wanted[1]};"
            f" intrinsics belong to one size{_turned(wanted, sizes)}"
        )
    turned = _turned(wanted, sizes)
    kept = _without(kept, lambda p: p.size != wanted, f"not {wanted[0]}x{wanted[1]} pixels{turned}", warnings)
    seen: set[str] = set()
    twice = [p for p in kept if p.digest in seen or seen.add(p.digest)]  # type: ignore[func-returns-value]
    kept = _without(kept, lambda p: any(p is t for t in twice), "the same file as another photo", warnings)
    named = Counter(p.camera for p in kept if p.camera)
    if len(named) > 1:
        most = named.most_common(1)[0][0]
        others = ", ".join(name for name in named if name != most)
        reason = f"taken with {others}, the others with {most}"
        kept = _without(kept, lambda p: p.camera not in ("", most), reason, warnings)
    widths = [p.blur for p in kept if np.isfinite(p.blur)]
    usual = float(np.median(widths)) if widths else np.inf
    limit = max(BLURRED * usual, usual + 1.0)
    kept = _without(kept, lambda p: p.blur > limit, f"blurred, edges over {limit:.1f} px wide", warnings)
    blank = [p for p in kept if not p.sightings]
    if blank:
        names = ", ".join(p.path.name for p in blank[:5]) + (", ..." if len(blank) > 5 else "")
        show = "shows" if len(blank) == 1 else "show"
        warnings.append(
            f"{len(blank)} of {plural(len(kept), 'photo')} {show} no board that could be read{_why(blank)}:"
            f" {names}"
        )
    return [renumbered(photo, index) for index, photo in enumerate(kept)], warnings


def _why(blank: Sequence[Photo]) -> str:
    """That photos are blurred, if all of a few that are looked at again are."""
    looked_at = blank[:: max(1, len(blank) // _SAMPLES)][:_SAMPLES]
    unsharp = all(_blurred([_grey(photo)]) for photo in looked_at)
    return ", blurred" if unsharp else ""


def _turned(wanted: tuple[int, int], sizes: Iterable[tuple[int, int]]) -> str:
    """That photos were turned by a program, where they were; a camera turns none, it writes a tag."""
    if wanted[::-1] not in sizes:
        return ""
    return " (turned by a program? take the files as the camera wrote them)"


def renumbered(photo: Photo, index: int) -> Photo:
    """The photo as number `index` of its set."""
    return replace(photo, sightings=tuple(replace(s, photo=index) for s in photo.sightings))


def _without(
    photos: list[Photo], bad: Callable[[Photo], bool], reason: str, warnings: list[str]
) -> list[Photo]:
    out = [photo for photo in photos if bad(photo)]
    if out:
        names = ", ".join(photo.path.name for photo in out[:5]) + (", ..." if len(out) > 5 else "")
        warnings.append(f"{len(out)} of {plural(len(photos), 'photo')} left out, {reason}: {names}")
    return [photo for photo in photos if not bad(photo)]


def require_boards(photos: Sequence[Photo], boards: BoardSet, out: Path | str) -> None:
    """Raise SourceError if no photo shows a board, with what was seen saved beside `out`, or a wrong one.

    Raises
    ------
    SourceError
        Naming what was looked for, and the dictionary or layout that would fit.
    """
    if not any(photo.sightings for photo in photos):
        images = [_grey(photo) for photo in photos[:: max(1, len(photos) // _SAMPLES)][:_SAMPLES]]
        hint = diagnosis.better_dictionary(images, boards)
        for board in boards.boards:
            hint = hint or diagnosis.better_layout(images, board)
        hint = hint or _blurred(images)
        drawn = diagnosis.draw_what_is_seen(images[0], boards)
        advice = hint or "are they lit, sharp and large enough, and is this their boards.yaml?"
        raise SourceError(
            f"no board found in {plural(len(photos), 'photo')}; looked for {diagnosis.wanted(boards)};"
            f" {advice}{_saved(drawn, Path(out))}"
        )
    for index, board in enumerate(boards.boards):
        showing = (p for p in photos if sum(s.board == index for s in p.sightings) > 1)
        hint = diagnosis.better_layout([_grey(photo) for photo in islice(showing, 1)], board)
        if hint:
            raise SourceError(hint)


def _blurred(images: Sequence[Image]) -> str:
    """That even the sharpest of some photos is blurred, in words; empty where it is not."""
    widths = [width for width in map(sharpest_edges, images) if np.isfinite(width)]
    if not widths or min(widths) < UNSHARP:
        return ""
    return (
        f"the photos are blurred, edges are {min(widths):.1f} px wide at best: focus, and hold the rig still"
    )


def _saved(drawn: Image, out: Path) -> str:
    """Save what was seen beside the folder asked for, which stays free for the next try; say where."""
    picture = Path(f"{out}-what-was-seen.jpg")
    try:
        with writing(picture):
            picture.parent.mkdir(parents=True, exist_ok=True)
        atomic_write(picture, cv2.imencode(".jpg", drawn)[1].tobytes())
    except OutputError:  # that no board was found is what matters
        return ""
    return f"; see {picture}"


def require_motion(photos: Sequence[Photo]) -> None:
    """Raise SourceError if all photos show the boards in the same places: one photo would tell as much."""
    places: dict[tuple[int, bool | None], list[tuple[float, float]]] = {}
    showing = [photo for photo in photos if photo.sightings]
    for photo in showing:
        for sighting in photo.sightings:
            x, y = sighting.pixels.mean(axis=0)
            places.setdefault((sighting.board, sighting.mirrored), []).append((float(x), float(y)))
    limit = SAME_POSE * photos[0].size[0]
    for spots in places.values():
        # With several views a board stands in several places in every photo: each has its like everywhere.
        at = np.array(spots)
        apart = np.linalg.norm(at[:, None] - at[None], axis=2)
        if np.any(np.count_nonzero(apart < limit, axis=1) < len(showing)):
            return
    move = "move and tilt the rig, or the boards, from photo to photo"
    if len(showing) == 1:
        raise SourceError(f"only one photo shows a board; take several, and {move}")
    raise SourceError(f"{len(showing)} photos show the boards in the same places; {move}")


def _grey(photo: Photo) -> Image:
    return to_grey(read_image(photo.path))
