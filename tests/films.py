"""Small films and image folders for tests, made by code."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import av
import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.generic]


def textured(height: int = 48, width: int = 64, seed: int = 0) -> NDArray[np.uint8]:
    """A smooth random colour image, kind to video codecs."""
    noise = np.random.default_rng(seed).integers(0, 256, (height, width, 3)).astype(np.float32)
    return np.clip(3 * (cv2.GaussianBlur(noise, (0, 0), 2) - 128) + 128, 0, 255).astype(np.uint8)


def moving(count: int, height: int = 48, width: int = 64) -> list[NDArray[np.uint8]]:
    """Frames of a texture that moves to the right by 2 pixels each."""
    image = textured(height, width)
    return [np.roll(image, 2 * k, axis=1) for k in range(count)]


def write_film(
    path: Path,
    images: Sequence[Image],
    *,
    codec: str = "libx264",
    pixels: str = "yuv420p",
    source: str = "bgr24",
    times: Sequence[int] | None = None,
    options: dict[str, str] | None = None,
) -> Path:
    """Encode images at 10 frames/s, or at `times` in tenths of a second."""
    with av.open(str(path), "w", options=options or {}) as container:
        stream = container.add_stream(codec, rate=10)
        stream.height, stream.width = images[0].shape[:2]
        stream.pix_fmt = pixels
        for k, image in enumerate(images):
            frame = av.VideoFrame.from_ndarray(image, format=source)
            frame.pts = k if times is None else times[k]
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def write_folder(folder: Path, images: Sequence[Image], times: Sequence[float] | None = None) -> Path:
    """Write 0.png, 1.png, ... and, if there are times, `timestamps.txt`."""
    folder.mkdir(parents=True)
    for k, image in enumerate(images):
        cv2.imwrite(str(folder / f"{k}.png"), image)
    if times is not None:
        lines = [f"{k}.png {time}" for k, time in enumerate(times)]
        (folder / "timestamps.txt").write_text("\n".join(["# file seconds", *lines]) + "\n")
    return folder


class FakeCapture:
    """Stands for `cv2.VideoCapture`: a camera that is unplugged after some images."""

    def __init__(self, images: int) -> None:
        self.left = images
        self.released = False

    def read(self) -> tuple[bool, Image | None]:
        self.left -= 1
        return (True, textured()) if self.left >= 0 else (False, None)

    def release(self) -> None:
        self.released = True
