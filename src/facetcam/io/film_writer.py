"""Write a film with FFmpeg through PyAV."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from facetcam.errors import OutputError
from facetcam.io.outputs import writing

# Of H.264; a rate factor of 18 is called visually lossless. Without the last, processors that round
# reciprocals in their own ways make films of their own from the same frames.
QUALITY = {"crf": "12", "preset": "veryfast", "x264-params": "cpu-independent=1"}
THREADS = 4  # not as many as there are processors, for the film depends on it


def write_film(path: Path, frames: Iterable[NDArray[np.uint8]], fps: int) -> None:
    """Encode frames as they come.

    Parameters
    ----------
    path : Path
        Its ending names the container, such as `.mp4`.
    frames : iterable of (H, W, 3) arrays
        BGR, of one size, with even height and width.
    fps : int
        Frames a second.

    Raises
    ------
    OutputError
        If there is no frame, its size is odd, or the film cannot be written.
    """
    import av

    frames = iter(frames)
    first = next(frames, None)
    if first is None:
        raise OutputError(f"{path}: no frame to write")
    height, width = first.shape[:2]
    if height % 2 or width % 2:
        raise OutputError(f"{path}: H.264 takes an even width and height, not {width}x{height}")
    with writing(path), av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=fps, options=QUALITY)
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.codec_context.time_base = Fraction(1, fps)
        stream.codec_context.thread_count = THREADS
        for image in chain([first], frames):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="bgr24")))
        container.mux(stream.encode())
