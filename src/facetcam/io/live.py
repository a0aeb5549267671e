"""A camera at this computer as a source."""

from __future__ import annotations

import time
from collections.abc import Iterator

import cv2

from facetcam.errors import SourceError
from facetcam.io.frames import Frame, Skipped


class LiveCamera:
    """Frames of camera number `index` as they come; times are seconds since the first one.

    Raises
    ------
    SourceError
        If there is no such camera; while iterating, if it stops delivering.
    """

    live = True
    count = None
    time_span = None

    def __init__(self, index: int) -> None:
        self.name = f"camera {index}"
        self.skipped: list[Skipped] = []
        self._capture = cv2.VideoCapture(index)
        delivered, image = self._capture.read()
        if not delivered:
            self._capture.release()
            raise SourceError(
                f"{self.name}: no such camera, or it delivers no image; is another program using it?"
            )
        self.size = (image.shape[1], image.shape[0])

    def __iter__(self) -> Iterator[Frame]:
        started: float | None = None
        index = 0
        try:
            while True:
                delivered, image = self._capture.read()
                now = time.monotonic()  # as near to the exposure as this interface allows
                if not delivered:
                    raise SourceError(f"{self.name}: stopped delivering images; was it unplugged?")
                started = now if started is None else started
                yield Frame(index, now - started, image, f"{index:06d}")
                index += 1
        finally:
            self._capture.release()
