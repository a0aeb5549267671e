"""A film as a source, decoded by FFmpeg through PyAV."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from facetcam.errors import SourceError
from facetcam.io.frames import Frame, Skipped

if TYPE_CHECKING:
    import av

TEXT_AS_FILM = {"tty"}  # FFmpeg plays plain text files as terminal art


class Video:
    """Frames of a film's first picture stream, at their presentation times, not turned by a rotation tag.

    Parameters
    ----------
    path : Path
    fps : float, optional
        Frame rate that replaces the film's own times.

    Raises
    ------
    SourceError
        If the file is missing, empty, no film, or has no frame; while iterating, if times do not increase.

    Notes
    -----
    Of a film that is cut off or damaged, the frames up to the damage are delivered and `skipped` says where
    it ends.
    """

    live = False

    def __init__(self, path: Path, fps: float | None = None) -> None:
        self.name = str(path)
        self.skipped: list[Skipped] = []
        self._path, self._fps = path, fps
        with self._opened() as (container, stream):
            self._rate = float(fps or stream.average_rate or 0)
            self._exact = stream.frames > 0
            self.count = stream.frames or _count_from_duration(container, self._rate)
            first = next(self._decoded(container, stream), None)
            if first is None:
                raise SourceError(f"{path}: no frame can be decoded; the film is empty or damaged")
            self.size = (first.width, first.height)
            self.time_span = self._span(self._time(first, 0))

    def __iter__(self) -> Iterator[Frame]:
        self.skipped.clear()
        delivered, last = 0, -np.inf
        with self._opened() as (container, stream):
            for index, frame in enumerate(self._decoded(container, stream)):
                timestamp = self._time(frame, index)
                if timestamp <= last:
                    raise SourceError(
                        f"{self.name}: frame {index} is at {timestamp:.6g} s, not after {last:.6g} s;"
                        " give --fps to number the frames instead"
                    )
                yield Frame(index, timestamp, _pixels(frame), f"{index:06d}")
                delivered, last = index + 1, timestamp
        self._say_if_cut_off(delivered)

    @contextmanager
    def _opened(self) -> Iterator[tuple[av.container.InputContainer, av.VideoStream]]:
        import av

        try:
            container = av.open(str(self._path))
        except (av.error.FFmpegError, OSError) as error:
            raise SourceError(f"{self.name}: cannot be read as a film ({error.strerror})") from error
        with container:
            if container.format.name in TEXT_AS_FILM or not container.streams.video:
                raise SourceError(f"{self.name}: holds no film; give a video file or a folder of images")
            stream = container.streams.video[0]
            stream.thread_type = "AUTO"
            yield container, stream

    def _decoded(
        self, container: av.container.InputContainer, stream: av.VideoStream
    ) -> Iterator[av.VideoFrame]:
        """Frames up to the first damage; those still in the decoder come out too."""
        import av

        packets = container.demux(stream)
        while True:
            try:
                packet = next(packets, None)
                frames = packet.decode() if packet is not None else []
            except av.error.FFmpegError:
                with suppress(av.error.FFmpegError):
                    yield from stream.codec_context.decode(None)
                return
            if packet is None:
                return
            for frame in frames:
                if frame.is_corrupt:
                    return
                yield frame

    def _time(self, frame: av.VideoFrame, index: int) -> float:
        if self._fps is not None:
            return index / self._fps
        if frame.time is None:
            raise SourceError(f"{self.name}: frame {index} has no time; give --fps")
        return float(frame.time)

    def _span(self, first: float) -> tuple[float, float] | None:
        if not self.count or not self._rate:
            return None
        return first, first + (self.count - 1) / self._rate

    def _say_if_cut_off(self, delivered: int) -> None:
        promised = self.count or 0
        slack = 0 if self._exact else max(2, promised // 20)  # a count from the duration is a guess
        if delivered < promised - slack:
            reason = f"the film is cut off or damaged, {delivered} of {promised} frames were read"
            self.skipped.append(Skipped(f"frame {delivered} and later", reason))


def _count_from_duration(container: av.container.InputContainer, rate: float) -> int | None:
    """Expected number of frames where the file does not tell it; None where even its duration is unknown."""
    if not container.duration or not rate:
        return None
    microseconds = 1e-6  # the unit of a container's duration
    return round(float(container.duration) * microseconds * rate)


def _pixels(frame: av.VideoFrame) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """Grey films as (H, W), others as (H, W, 3) BGR; more than 8 bits become 16."""
    components = frame.format.components
    depth = "16le" if components[0].bits > 8 else ""
    if len(components) == 1 and not frame.format.has_palette:
        return np.asarray(frame.to_ndarray(format=f"gray{depth}"))
    return np.asarray(frame.to_ndarray(format=f"bgr{'48le' if depth else '24'}"))
