"""Calibration in memory: from photos, or arrays, to a rig."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from facetcam.calibration.boards import BoardSet
from facetcam.calibration.result import Calibration
from facetcam.errors import FacetcamError
from facetcam.pipelines.calibrate import solved
from facetcam.pipelines.calibrate_inputs import Images, look
from facetcam.pipelines.demo import unwatched
from facetcam.pipelines.photos import SecondLook
from facetcam.rig import Rig


def calibrate(
    images: Images | Sequence[NDArray[np.generic]],
    boards: BoardSet | Path | str,
    rig: Rig | Path | str | None = None,
) -> Calibration:
    """Calibrate a rig in memory.

    Parameters
    ----------
    images : path, sequence of paths, or sequence of (H, W) or (H, W, 3) arrays
        Photos of the boards, as the camera gave them: grey or BGR, 8 or 16 bit.
    boards : BoardSet or path
    rig : Rig or path, optional
        As drawn; without it the views are found from the photos.

    Returns
    -------
    Calibration
        `calibration.rig` is the rig as built.

    Raises
    ------
    FacetcamError
        If the photos, the boards or the rig cannot be used, or nothing can be solved.
    """
    with tempfile.TemporaryDirectory() as scratch:
        kept = images if isinstance(images, (str, Path)) else _on_disk(images, Path(scratch))
        seen = look(kept, boards, Path(tempfile.gettempdir()) / Path(scratch).name / "seen", rig=rig)
        return solved(seen, SecondLook(seen.photos), unwatched)


def _on_disk(images: Sequence[Path | str] | Sequence[NDArray[np.generic]], folder: Path) -> list[Path | str]:
    """Arrays as files that lose nothing: photos are read again where they are needed, never all at once."""
    import cv2

    paths: list[Path | str] = []
    for index, image in enumerate(images):
        if isinstance(image, (str, Path)):
            paths.append(image)
            continue
        path = folder / f"{index:06d}.png"
        if image.dtype not in (np.uint8, np.uint16) or image.ndim not in (2, 3):
            raise FacetcamError(
                f"image {index}: expected (H, W) or (H, W, 3) of 8 or 16 bit, got {image.shape} {image.dtype}"
            )
        path.write_bytes(cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1].tobytes())
        paths.append(path)
    return paths
