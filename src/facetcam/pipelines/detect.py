"""From images to their SIICF corners."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from facetcam.features import SIICF, Keypoints
from facetcam.io.frames import Frame
from facetcam.io.outputs import atomic_write, fresh_folder, require_absent
from facetcam.io.sources import open_source
from facetcam.pipelines.progress import Progress, keeping, silent
from facetcam.viz.pictures import draw_points

PICTURE_WIDTH = 1600


@dataclass(frozen=True, slots=True)
class Detections:
    """Number of corners in each image, and what was not as it should be."""

    corners: tuple[int, ...]
    warnings: tuple[str, ...]


def run_detect(
    source: Path | str | int,
    out: Path | str,
    *,
    max_features: int = 1000,
    mode: str = "robust",
    descriptor: str = "gradients",
    progress: Progress = silent,
) -> Detections:
    """Find corners in every image; write `000000.npz` (arrays) and `000000.jpg` (picture) for each.

    The arrays are those of `Keypoints`, besides `descriptors` (N, D) and the `image`'s name.

    Raises
    ------
    FacetcamError
        If the source cannot be read, a parameter is wrong, or a result cannot be written.
    """
    require_absent(out)
    detector = SIICF.create(max_features=max_features, mode=mode, descriptor=descriptor)
    corners: list[int] = []
    with open_source(source, timed=False) as images:
        folder = fresh_folder(out)
        with keeping(folder, lambda reason: None):  # each image is complete by itself
            for frame in images:
                keypoints, descriptors = detector.detectAndCompute(frame.image)
                write_corners(folder, frame, keypoints, descriptors)
                corners.append(len(keypoints))
                progress(len(corners), images.count)
        return Detections(tuple(corners), images.warnings)


def write_corners(folder: Path, frame: Frame, keypoints: Keypoints, descriptors: NDArray[Any]) -> None:
    """Write the arrays and the picture of one image."""
    arrays = io.BytesIO()
    np.savez_compressed(
        arrays,
        xy=keypoints.xy,
        size=keypoints.size,
        angle=keypoints.angle,
        response=keypoints.response,
        level=keypoints.level,
        descriptors=descriptors,
        image=np.array(frame.name),
    )
    atomic_write(folder / f"{frame.index:06d}.npz", arrays.getvalue())
    picture = draw_points(frame.image, keypoints.xy, np.zeros(len(keypoints), int), PICTURE_WIDTH)
    atomic_write(folder / f"{frame.index:06d}.jpg", cv2.imencode(".jpg", picture)[1].tobytes())
