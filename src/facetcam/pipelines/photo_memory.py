"""One photo with the boards seen in it, and its memory on disk, so that it is looked at once only."""

from __future__ import annotations

import hashlib
import io
import os
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from facetcam.calibration.boards import BoardSet
from facetcam.calibration.sightings import Sighting
from facetcam.errors import FacetcamError
from facetcam.io.outputs import atomic_write

METHOD = 5  # of detection: another one makes what is remembered useless


@dataclass(frozen=True, eq=False)
class Photo:
    """One photo and the boards seen in it.

    Attributes
    ----------
    path : Path
    size : (int, int)
        Width and height in pixels.
    digest : str
        SHA-256 of the file.
    camera : str
        Maker, model and focal length that the file names; empty where it names none.
    blur : float
        Width (sigma, pixels) of the edges at the corners found; NaN where there is none.
    sightings : tuple of Sighting
    """

    path: Path
    size: tuple[int, int]
    digest: str
    camera: str
    blur: float
    sightings: tuple[Sighting, ...]

    @property
    def corners(self) -> int:
        """Corners found, over all sightings."""
        return sum(map(len, self.sightings))


def default_cache() -> Path:
    """Where sightings are remembered: the user's cache folder."""
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "facetcam" / "sightings"


def key(digest: str, boards: BoardSet) -> str:
    """Name of what is remembered of a photo with these boards."""
    return hashlib.sha256(f"{METHOD} {digest} {boards.digest}".encode()).hexdigest()[:40]


def remember(file: Path | None, photo: Photo) -> None:
    """Keep what was found; where it cannot be kept, nothing is lost but time."""
    if file is None:
        return
    arrays: dict[str, NDArray[np.generic]] = {
        "size": np.array(photo.size),
        "camera": np.array(photo.camera),
        "blur": np.array(photo.blur),
        "boards": np.array([s.board for s in photo.sightings], dtype=np.int64),
        # 1 mirrored, 0 not, -1 unknown
        "mirrored": np.array([-1 if s.mirrored is None else int(s.mirrored) for s in photo.sightings]),
    }
    for index, sighting in enumerate(photo.sightings):
        arrays[f"corners{index}"] = sighting.corners
        arrays[f"pixels{index}"] = sighting.pixels
    content = io.BytesIO()
    np.savez(content, **arrays)  # type: ignore[arg-type]
    with suppress(FacetcamError, OSError):
        file.parent.mkdir(parents=True, exist_ok=True)
        atomic_write(file, content.getvalue())


def recall(file: Path | None, path: Path, digest: str) -> Photo | None:
    """What was kept of a photo; None where nothing, or nothing whole, was."""
    if file is None:
        return None
    try:
        with np.load(io.BytesIO(file.read_bytes()), allow_pickle=False) as kept:
            sightings = tuple(
                Sighting(0, int(board), kept[f"corners{k}"], kept[f"pixels{k}"], None if m < 0 else bool(m))
                for k, (board, m) in enumerate(zip(kept["boards"], kept["mirrored"]))
            )
            width, height = (int(n) for n in kept["size"])
            return Photo(path, (width, height), digest, str(kept["camera"]), float(kept["blur"]), sightings)
    except (OSError, ValueError, KeyError, EOFError, BadZipFile):
        return None  # not there, cut off or of another kind: looked at again
