"""Point clouds as binary PLY files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from facetcam.errors import FacetcamError, SourceError
from facetcam.io.outputs import atomic_write

VERTEX = np.dtype([("position", "<f4", 3), ("colour", "u1", 3)])
HEADER = """ply
format binary_little_endian 1.0
element vertex {count}
property float x
property float y
property float z
property uchar red
property uchar green
property uchar blue
end_header
"""


def write_ply(path: Path | str, points: ArrayLike, colours: ArrayLike) -> None:
    """Write a coloured point cloud.

    Parameters
    ----------
    path : path
    points : (N, 3) array
        Metres.
    colours : (N, 3) array of uint8
        Red, green, blue.

    Raises
    ------
    FacetcamError
        If the arrays do not fit each other or a coordinate is not finite.
    OutputError
        If the file cannot be written.
    """
    positions = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    rgb = np.asarray(colours).reshape(-1, 3)
    if len(positions) != len(rgb):
        raise FacetcamError(f"{path}: {len(positions)} points but {len(rgb)} colours")
    if not np.all(np.isfinite(positions)):
        raise FacetcamError(f"{path}: a point is not finite")
    vertices = np.empty(len(positions), VERTEX)
    vertices["position"], vertices["colour"] = positions, rgb
    atomic_write(Path(path), HEADER.format(count=len(vertices)).encode() + vertices.tobytes())


def read_ply(path: Path | str) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    """Read a cloud that `write_ply` wrote: positions (N, 3) in metres, and red, green, blue (N, 3).

    Raises
    ------
    SourceError
        If the file cannot be read, is another kind of PLY, or is cut off.
    """
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        raise SourceError(f"{path}: {error.strerror}") from error
    head, end, body = data.partition(b"end_header\n")
    count = len(body) // VERTEX.itemsize
    if head + end != HEADER.format(count=count).encode() or len(body) % VERTEX.itemsize:
        raise SourceError(f"{path}: damaged, or not the map.ply of a run")
    vertices = np.frombuffer(body, VERTEX)
    return vertices["position"].astype(np.float64), vertices["colour"].copy()
