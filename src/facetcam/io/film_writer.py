"""Write a film with FFmpeg through PyAV."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from facetcam.io.outputs import writing

QUALITY = "12"  # constant rate factor of H.264; 18 is called visually lossless


def write_film(path: Path, frames: Iterable[NDArray[np.uint8]], fps: int) -> None:
    """Encode frames (H, W, 3) BGR as they come; height and width must be even.

    Raises
    ------
    OutputError
        If the film cannot be written.
    """
    import av

    with writing(path), av.open(str(path), "w") as container:
        stream = None
        for image in frames:
            if stream is None:
                stream = container.add_stream(
                    "libx264", rate=fps, options={"crf": QUALITY, "preset": "veryfast"}
                )
                stream.height, stream.width = image.shape[:2]
                stream.pix_fmt = "yuv420p"
                stream.codec_context.time_base = Fraction(1, fps)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="bgr24")))
        if stream is not None:
            container.mux(stream.encode())
