"""ROS bags as sources of images and odometry, against bags written by the rosbags library."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from facetcam.errors import SourceError
from facetcam.io.odometry import read_odometry
from facetcam.io.sources import open_source

rosbags = pytest.importorskip("rosbags")
from rosbags.rosbag1 import Writer as Writer1  # noqa: E402
from rosbags.rosbag2 import StoragePlugin  # noqa: E402
from rosbags.rosbag2 import Writer as Writer2  # noqa: E402
from rosbags.typesys import Stores, get_typestore  # noqa: E402

Image = NDArray[np.uint8]
Messages = list[tuple[str, float, Any]]  # topic, time of recording, message

SIZE = (12, 16)
START = 1.7e9
LATE = 0.25  # seconds from the camera to the recording


class Ros:
    """Messages of one release, and bags of them."""

    def __init__(self, kind: str) -> None:
        self.kind = kind
        self.store = get_typestore(Stores.ROS1_NOETIC if kind == "ros1" else Stores.ROS2_HUMBLE)

    def make(self, name: str, **fields: Any) -> Any:
        return self.store.types[name](**fields)

    def header(self, time: float) -> Any:
        seconds, fraction = divmod(time, 1.0)
        stamp = self.make("builtin_interfaces/msg/Time", sec=int(seconds), nanosec=int(fraction * 1e9))
        more = {"seq": 0} if self.kind == "ros1" else {}
        return self.make("std_msgs/msg/Header", stamp=stamp, frame_id="camera", **more)

    def image(self, time: float, pixels: NDArray[Any], encoding: str, padding: int = 0) -> Any:
        rows = np.ascontiguousarray(pixels).view(np.uint8).reshape(len(pixels), -1)
        padded = np.pad(rows, ((0, 0), (0, padding)))
        return self.make(
            "sensor_msgs/msg/Image",
            header=self.header(time),
            height=pixels.shape[0],
            width=pixels.shape[1],
            encoding=encoding,
            is_bigendian=int(pixels.dtype.byteorder == ">"),
            step=padded.shape[1],
            data=padded.ravel(),
        )

    def compressed(self, time: float, data: bytes) -> Any:
        packed = np.frombuffer(data, np.uint8)
        return self.make(
            "sensor_msgs/msg/CompressedImage", header=self.header(time), format="png", data=packed
        )

    def odometry(self, time: float, x: float, y: float, yaw: float) -> Any:
        point = self.make("geometry_msgs/msg/Point", x=x, y=y, z=0.0)
        turn = self.make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=np.sin(yaw / 2), w=np.cos(yaw / 2))
        still = self.make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
        none = np.zeros(36)
        pose = self.make("geometry_msgs/msg/Pose", position=point, orientation=turn)
        twist = self.make("geometry_msgs/msg/Twist", linear=still, angular=still)
        return self.make(
            "nav_msgs/msg/Odometry",
            header=self.header(time),
            child_frame_id="base",
            pose=self.make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=none),
            twist=self.make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=none),
        )

    def write(self, folder: Path, messages: Messages) -> Path:
        first = self.kind == "ros1"
        path = folder / ("drive.bag" if first else "drive")
        plugin = StoragePlugin.MCAP if self.kind == "mcap" else StoragePlugin.SQLITE3
        writer: Any = Writer1(path) if first else Writer2(path, version=9, storage_plugin=plugin)
        pack = self.store.serialize_ros1 if first else self.store.serialize_cdr
        with writer:
            known: dict[str, Any] = {}
            for topic, time, message in messages:
                kind = message.__msgtype__
                if topic not in known:
                    known[topic] = writer.add_connection(topic, kind, typestore=self.store)
                writer.write(known[topic], int(time * 1e9), pack(message, kind))
        return path


@pytest.fixture(params=["ros1", "sqlite", "mcap"])
def ros(request: pytest.FixtureRequest) -> Ros:
    return Ros(request.param)


def pictures(n: int) -> list[Image]:
    rng = np.random.default_rng(1)
    return [rng.integers(0, 256, (*SIZE, 3), np.uint8) for _ in range(n)]


def film(ros: Ros, images: list[Image], topic: str = "/cam/image") -> Messages:
    times = [START + 0.1 * k for k in range(len(images))]
    return [(topic, t + LATE, ros.image(t, image, "bgr8")) for t, image in zip(times, images)]


def test_images_come_at_the_times_of_their_headers(ros: Ros, tmp_path: Path) -> None:
    images = pictures(5)
    with open_source(ros.write(tmp_path, film(ros, images))) as source:
        frames = list(source)
    assert source.count == 5
    assert source.size == (16, 12)
    assert [f.timestamp - START for f in frames] == pytest.approx(np.arange(5) / 10, abs=1e-6)
    assert source.time_span == pytest.approx((START, START + 0.4), abs=1e-6)
    assert all(np.array_equal(f.image, image) for f, image in zip(frames, images))


def test_a_file_of_a_recording_stands_for_it(tmp_path: Path) -> None:
    folder = Ros("mcap").write(tmp_path, film(Ros("mcap"), pictures(2)))
    with open_source(next(folder.glob("*.mcap"))) as source:
        assert len(list(source)) == 2


def test_compressed_images(ros: Ros, tmp_path: Path) -> None:
    images = pictures(3)
    packed = [cv2.imencode(".png", image)[1].tobytes() for image in images]
    messages = [("/c", START + k, ros.compressed(START + k, data)) for k, data in enumerate(packed)]
    with open_source(ros.write(tmp_path, messages)) as source:
        assert all(np.array_equal(f.image, image) for f, image in zip(source, images, strict=True))


def mosaic(order: str) -> Image:
    """A red picture as a sensor with this pattern sees it."""
    tile = np.array([255 if colour == "r" else 0 for colour in order], np.uint8).reshape(2, 2)
    return np.tile(tile, (6, 8))


def bayer(order: str) -> tuple[str, Image]:
    return f"bayer_{order}8", mosaic(order)


RED = np.full((*SIZE, 3), (0, 0, 255), np.uint8)
GREY16 = np.arange(192, dtype=np.uint16).reshape(SIZE) * 300
YUYV = np.tile(np.array([[[82, 90], [82, 240]]], np.uint8), (12, 8, 1))  # red by BT.601


@pytest.mark.parametrize(
    ("encoding", "pixels", "expected"),
    [
        ("mono8", RED[:, :, 2], RED[:, :, 2]),
        ("mono16", GREY16, GREY16),
        ("mono16", GREY16.astype(">u2"), GREY16),
        ("rgb8", RED[:, :, ::-1], RED),
        ("rgba8", np.dstack([RED[:, :, ::-1], RED[:, :, :1]]), RED),
        *((*bayer(order), RED) for order in ("rggb", "bggr", "gbrg", "grbg")),
        ("yuv422_yuy2", YUYV, RED),
        ("uyvy", YUYV[:, :, ::-1], RED),
    ],
)
def test_encodings(tmp_path: Path, encoding: str, pixels: Image, expected: Image) -> None:
    ros = Ros("sqlite")
    path = ros.write(tmp_path, [("/i", START, ros.image(START, pixels, encoding, padding=6))])
    with open_source(path) as source:
        image = next(iter(source)).image
    assert image.dtype == expected.dtype
    inner = np.s_[2:-2, 2:-2]  # demosaicing guesses at the border
    assert np.abs(image[inner].astype(int) - expected[inner]).max() <= 2


def test_of_several_topics_one_must_be_named(ros: Ros, tmp_path: Path) -> None:
    left, right = pictures(2), pictures(4)[2:]
    path = ros.write(tmp_path, film(ros, left, "/left") + film(ros, right, "/cam/right"))
    with pytest.raises(SourceError, match=r"2 image topics; give .*:TOPIC, one of /cam/right /left"):
        open_source(path)
    with open_source(f"{path}:/cam/right") as source:
        assert all(np.array_equal(f.image, image) for f, image in zip(source, right, strict=True))
    with pytest.raises(SourceError, match="no image on /up"):
        open_source(f"{path}:/up")


def wheels(ros: Ros, order: list[int]) -> Messages:
    """A circle to the left, with one wheel of a metre a second."""
    rows = [(START + 0.1 * k, np.sin(0.1 * k), 1 - np.cos(0.1 * k), 0.1 * k) for k in range(60)]
    return [("/odom", rows[0][0] + 0.1 * n, ros.odometry(*rows[k])) for n, k in enumerate(order)]


def test_odometry_of_a_bag(ros: Ros, tmp_path: Path) -> None:
    """Messages may overtake each other, or come twice; a heading grows past half a turn."""
    order = [1, 0, *range(2, 60), 59]
    path = ros.write(tmp_path, wheels(ros, order))
    odometry = read_odometry(path)
    assert len(odometry.times) == 60
    assert odometry.at(START + 4.05) == pytest.approx((np.sin(4.05), 1 - np.cos(4.05), 4.05), abs=2e-3)


def test_a_bag_without_the_topic_says_what_it_holds(ros: Ros, tmp_path: Path) -> None:
    path = ros.write(tmp_path, wheels(ros, [0, 1]))
    with pytest.raises(SourceError, match=r"holds no image; its topics are /odom \(nav_msgs/msg/Odometry\)"):
        open_source(path)


def test_images_that_cannot_be_read_are_passed_over(tmp_path: Path) -> None:
    ros, images = Ros("ros1"), pictures(4)
    messages = film(ros, images)
    messages[1][2].data = messages[1][2].data[:-1]
    messages[2][2].encoding = "infrared"
    with open_source(ros.write(tmp_path, messages)) as source:
        assert [f.index for f in source] == [0, 3]
    assert "575 bytes are no 16x12 pixels of bgr8" in source.warnings[0]
    assert "'infrared' is none of" in source.warnings[1]


def test_times_that_do_not_increase_are_refused(ros: Ros, tmp_path: Path) -> None:
    messages = film(ros, pictures(3))
    messages[2][2].header.stamp = messages[1][2].header.stamp
    path = ros.write(tmp_path, messages)
    with pytest.raises(SourceError, match=r"not after .* give --fps"), open_source(path) as source:
        list(source)
    with open_source(path, fps=5.0) as source:
        assert [f.timestamp for f in source] == [0.0, 0.2, 0.4]


def cut(data: bytes) -> bytes:
    return data[: len(data) // 2]


def spoil(data: bytes) -> bytes:
    return data[:200] + bytes(len(data) - 200)


@pytest.mark.parametrize("damage", [cut, spoil, lambda _: b"no bag at all"], ids=["cut", "spoilt", "text"])
def test_a_damaged_bag_is_one_line(ros: Ros, tmp_path: Path, damage: Callable[[bytes], bytes]) -> None:
    path = ros.write(tmp_path, film(ros, pictures(20)))
    file = path if path.is_file() else next(f for f in path.iterdir() if f.suffix != ".yaml")
    file.write_bytes(damage(file.read_bytes()))
    try:
        with open_source(path) as source:
            assert len(list(source)) < 20
            assert "and later skipped" in source.warnings[-1]
            said = source.warnings[-1]
    except SourceError as error:
        said = str(error)
    assert f"{path}: damaged, or no bag" in said
    assert "\n" not in said


def test_without_the_library_its_name_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = Ros("ros1").write(tmp_path, film(Ros("ros1"), pictures(1)))
    monkeypatch.setattr("facetcam.io.ros_bag.find_spec", lambda name: None)
    with pytest.raises(SourceError, match=r"pip install facetcam\[ros\]"):
        open_source(path)
