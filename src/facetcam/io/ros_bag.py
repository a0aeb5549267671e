"""Images and wheel odometry in a bag of ROS 1 or ROS 2, read without ROS."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from facetcam.errors import SourceError
from facetcam.io.frames import Frame, Skipped
from facetcam.io.ros_images import pixels

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader

IMAGES = {"sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"}
ODOMETRY = {"nav_msgs/msg/Odometry"}
FILES = {".bag", ".mcap", ".db3"}
METADATA = "metadata.yaml"

_NANOSECOND = 1e-9
_LAST = (2.0, 60.0)  # seconds before the end in which the last image is looked for first


@dataclass(frozen=True, slots=True)
class Bag:
    """A bag, and the topic asked for; None takes the only one of its kind."""

    path: Path
    topic: str | None = None

    @classmethod
    def at(cls, location: Path | str) -> Bag | None:
        """The bag at `PATH` or `PATH:/TOPIC`; None where something else lies there."""
        whole, (path, mark, topic) = Path(str(location)), str(location).rpartition(":/")
        if _is_bag(whole):
            return cls(_recording(whole))
        return cls(_recording(Path(path)), f"/{topic}") if mark and _is_bag(Path(path)) else None

    @contextmanager
    def opened(self) -> Iterator[AnyReader]:
        """The reader; whatever it cannot bear is a SourceError."""
        if find_spec("rosbags") is None:
            raise SourceError(f"{self.path}: reading ROS bags needs rosbags: pip install facetcam[ros]")
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore

        try:
            with AnyReader([self.path], default_typestore=get_typestore(Stores.LATEST)) as reader:
                yield reader
        except SourceError:
            raise
        except Exception as error:  # a damaged bag may fail anywhere in its reader
            raise SourceError(f"{self.path}: damaged, or no bag ({_first_line(error)})") from error

    def messages(
        self, reader: AnyReader, kinds: set[str], last: float | None = None
    ) -> Iterator[tuple[float, Any]]:
        """Times in seconds and messages of the topic, all or those of the `last` seconds.

        The time is that of the message's header, or where that is zero, of the recording.
        """
        topic = self._chosen(reader, kinds)
        connections = [c for c in reader.connections if c.topic == topic]
        start = None if last is None else reader.end_time - int(last / _NANOSECOND)
        for connection, received, raw in reader.messages(connections, start=start):
            message: Any = reader.deserialize(raw, connection.msgtype)
            stamp = message.header.stamp
            taken = stamp.sec + _NANOSECOND * stamp.nanosec
            yield taken or _NANOSECOND * received, message

    def count(self, reader: AnyReader, kinds: set[str]) -> int:
        """Messages of the topic."""
        return reader.topics[self._chosen(reader, kinds)].msgcount

    def _chosen(self, reader: AnyReader, kinds: set[str]) -> str:
        """The topic; SourceError where it is absent, or is not to be told."""
        fitting = sorted({c.topic for c in reader.connections if c.msgtype in kinds and c.msgcount})
        what = "image" if kinds is IMAGES else "odometry"
        if self.topic in fitting or (self.topic is None and len(fitting) == 1):
            return self.topic or fitting[0]
        if not fitting:
            raise SourceError(f"{self.path}: holds no {what}; its topics are {_listed(reader)}")
        wrong = f"no {what} on {self.topic}" if self.topic else f"{len(fitting)} {what} topics"
        raise SourceError(f"{self.path}: {wrong}; give {self.path}:TOPIC, one of {' '.join(fitting)}")


class RosBag:
    """Images of one topic, raw or compressed, at the times of their headers.

    Parameters
    ----------
    bag : Bag
    fps : float, optional
        Frame rate that replaces the times of the headers.

    Raises
    ------
    SourceError
        If it is damaged from the start, has no image or more than one topic of them; while iterating, if
        sizes differ or times do not increase.
    """

    live = False

    def __init__(self, bag: Bag, fps: float | None = None) -> None:
        self.name = str(bag.path) + (f":{bag.topic}" if bag.topic else "")
        self.skipped: list[Skipped] = []
        self._bag, self._fps = bag, fps
        with bag.opened() as reader:
            self.count = bag.count(reader, IMAGES)
            self.size = self._first_size(reader)
            self.time_span = self._span(reader)

    def __iter__(self) -> Iterator[Frame]:
        self.skipped.clear()
        index, last = 0, -np.inf
        try:
            with self._bag.opened() as reader:
                for index, (time, message) in enumerate(self._bag.messages(reader, IMAGES)):
                    timestamp = time if self._fps is None else index / self._fps
                    image = self._read(index, message)
                    if image is None:
                        continue
                    self._require_next(index, image, timestamp, last)
                    yield Frame(index, timestamp, image, f"{index:06d}")
                    last = timestamp
        except SourceError as error:
            if not isinstance(error.__cause__, Exception):
                raise
            self.skipped.append(Skipped(f"image {index + 1} and later", str(error)))

    def _require_next(self, index: int, image: NDArray[Any], timestamp: float, last: float) -> None:
        if (image.shape[1], image.shape[0]) != self.size:
            width, height = self.size
            raise SourceError(
                f"{self.name}: image {index} has {image.shape[1]}x{image.shape[0]} pixels, those before it"
                f" {width}x{height}"
            )
        if timestamp <= last:
            raise SourceError(
                f"{self.name}: image {index} is at {timestamp:.6f} s, not after {last:.6f} s;"
                " give --fps to number the frames instead"
            )

    def _read(self, index: int, message: Any) -> NDArray[np.uint8] | NDArray[np.uint16] | None:
        """The image, or None with the reason noted."""
        try:
            return pixels(message)
        except SourceError as error:
            self.skipped.append(Skipped(f"image {index}", str(error)))
            return None

    def _first_size(self, reader: AnyReader) -> tuple[int, int]:
        for index, (_, message) in enumerate(self._bag.messages(reader, IMAGES)):
            image = self._read(index, message)
            if image is not None:
                return image.shape[1], image.shape[0]
        raise SourceError(f"{self.name}: no image can be read ({self.skipped[0].reason})")

    def _span(self, reader: AnyReader) -> tuple[float, float]:
        if self._fps is not None:
            return 0.0, (self.count - 1) / self._fps
        first, _ = next(self._bag.messages(reader, IMAGES))
        for seconds in (*_LAST, None):
            times = [time for time, _ in self._bag.messages(reader, IMAGES, seconds)]
            if times:
                break
        return first, max(times)


def wheel_odometry(bag: Bag) -> NDArray[np.float64]:
    """Times, x, y and yaw (N, 4) of a topic of odometry, in the order of their times.

    Raises
    ------
    SourceError
        If the bag is damaged or the topic is not to be told.
    """
    with bag.opened() as reader:
        rows = [(t, *_planar(message.pose.pose)) for t, message in bag.messages(reader, ODOMETRY)]
    table = np.array(rows, np.float64)
    return table[np.unique(table[:, 0], return_index=True)[1]]


def _planar(pose: Any) -> tuple[float, float, float]:
    q = pose.orientation
    yaw = np.arctan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y**2 + q.z**2))
    return pose.position.x, pose.position.y, float(yaw)


def _is_bag(path: Path) -> bool:
    if path.is_dir():
        return (path / METADATA).is_file()
    return path.is_file() and path.suffix.lower() in FILES


def _recording(path: Path) -> Path:
    """A recording of ROS 2 is a folder; a file in it stands for it."""
    inside = path.is_file() and path.suffix.lower() != ".bag" and (path.parent / METADATA).is_file()
    return path.parent if inside else path


def _listed(reader: AnyReader) -> str:
    return " ".join(f"{name} ({info.msgtype})" for name, info in reader.topics.items()) or "none"


def _first_line(error: Exception) -> str:
    return (str(error).strip() or type(error).__name__).splitlines()[0]
