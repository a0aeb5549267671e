"""Trajectories and odometry on disk: exact round trips, and every wrong line named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from facetcam.errors import FacetcamError, SourceError
from facetcam.io.odometry import Odometry, read_odometry
from facetcam.io.trajectories import TumWriter, read_tum, write_tum


def random_poses(count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = Rotation.random(count, random_state=rng).as_matrix()
    poses[:, :3, 3] = rng.uniform(-10, 10, (count, 3))
    return np.cumsum(rng.uniform(0.01, 1.0, count)), poses


class TestTum:
    def test_round_trip(self, tmp_path: Path) -> None:
        times, poses = random_poses(50)
        write_tum(tmp_path / "a.tum", times, poses)
        back_times, back_poses = read_tum(tmp_path / "a.tum")
        np.testing.assert_allclose(back_times, times, atol=1e-9)
        np.testing.assert_allclose(back_poses, poses, atol=1e-8)

    def test_lines_are_as_others_write_them(self, tmp_path: Path) -> None:
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_euler("z", 90, degrees=True).as_matrix()
        pose[:3, 3] = 1, -2, 0.5
        write_tum(tmp_path / "a.tum", np.array([1403636579.763555527]), pose[None])
        header, line = (tmp_path / "a.tum").read_text().splitlines()
        assert header == "# timestamp tx ty tz qx qy qz qw"
        assert line.split()[0].startswith("1403636579.7635555")
        half = f"{np.sqrt(0.5):.9f}"
        assert line.split()[1:] == [
            "1.000000000", "-2.000000000", "0.500000000", "0.000000000", "0.000000000", half, half
        ]  # fmt: skip

    def test_lines_are_on_disk_at_once(self, tmp_path: Path) -> None:
        times, poses = random_poses(3)
        with TumWriter(tmp_path / "a.tum") as writer:
            for count, (time, pose) in enumerate(zip(times, poses, strict=True), start=1):
                writer.append(time, pose)
                assert len(read_tum(tmp_path / "a.tum")[0]) == count

    def test_a_pose_that_is_not_finite_is_never_written(self, tmp_path: Path) -> None:
        pose = np.eye(4)
        pose[0, 3] = np.nan
        with pytest.raises(FacetcamError, match="not finite"):
            write_tum(tmp_path / "a.tum", np.zeros(1), pose[None])
        assert not (tmp_path / "a.tum").exists()

    @pytest.mark.parametrize(
        ("content", "message"),
        [
            ("", "no data"),
            ("# only a comment\n", "no data"),
            ("0 0 0 0 0 0 0\n", "line 1: expected 8 values"),
            ("0 0 0 0 0 0 0 1\n1 0 0 x 0 0 0 1\n", "line 2: 'x' is not a number"),
            (
                "timestamp tx ty tz qx qy qz qw\n",
                "line 1: 'timestamp' is not a number; a line of names begins with #",
            ),
            ("0 0 0 nan 0 0 0 1\n", "line 1: a value is not finite"),
            ("1 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n", "times must increase"),
            ("0 0 0 0 0 0 0 0\n", "quaternion at 0.000000 s has length 0, not 1"),
            ("0 0 0 0 1 2 3 4\n", "has length 5.48, not 1"),
        ],
    )
    def test_bad_files(self, tmp_path: Path, content: str, message: str) -> None:
        path = tmp_path / "bad.tum"
        path.write_text(content)
        with pytest.raises(SourceError, match=rf"bad\.tum.*{message}"):
            read_tum(path)

    def test_missing_or_binary_file(self, tmp_path: Path) -> None:
        with pytest.raises(SourceError, match=r"none\.tum: No such file"):
            read_tum(tmp_path / "none.tum")
        (tmp_path / "a.tum").write_bytes(b"\xff\x00\xfe")
        with pytest.raises(SourceError, match="not a text file"):
            read_tum(tmp_path / "a.tum")


class TestOdometry:
    def table(self) -> Odometry:
        yaw = np.unwrap([3.0, -3.1, -2.9])
        return Odometry(np.array([1.0, 1.2, 1.4]), np.array([0.0, 1, 3]), np.array([0.0, 0, 1]), yaw)

    def test_interpolates_between_rows_over_the_wrap_of_yaw(self) -> None:
        x, y, yaw = self.table().at(1.1)
        assert (x, y) == pytest.approx((0.5, 0.0))
        assert yaw == pytest.approx((3.0 + 2 * np.pi - 3.1) / 2)

    @pytest.mark.parametrize(("time", "x"), [(1.0, 0.0), (1.2, 1.0), (1.4, 3.0)])
    def test_rows_themselves(self, time: float, x: float) -> None:
        assert self.table().at(time)[0] == x

    @pytest.mark.parametrize("time", [0.999, 1.401])
    def test_nothing_is_invented_outside(self, time: float) -> None:
        assert self.table().at(time) is None

    def test_nothing_is_invented_in_a_gap(self) -> None:
        table = Odometry(np.array([0.0, 0.1, 5.0]), *np.zeros((3, 3)))
        assert table.at(0.05) is not None
        assert table.at(2.0) is None
        assert table.at(5.0) is not None

    def test_cover(self) -> None:
        self.table().require_cover((0.95, 1.45), "film", slack=0.1)
        with pytest.raises(
            SourceError, match=r"covers 1\.000 to 1\.400 s, but film runs from 0\.500 to 1\.300 s"
        ):
            self.table().require_cover((0.5, 1.3), "film", slack=0.1)
        with pytest.raises(SourceError, match="covers"):
            self.table().require_cover((1.0, 2.0), "film", slack=0.1)

    def test_reads_a_file(self, tmp_path: Path) -> None:
        (tmp_path / "o.csv").write_text("timestamp,x,y,yaw\n0.0,0,0,0\n0.1,0.05,-0.002,-0.07\n")
        assert read_odometry(tmp_path / "o.csv").at(0.1) == (0.05, -0.002, -0.07)

    @pytest.mark.parametrize(
        ("content", "message"),
        [
            ("", "first line must be 'timestamp,x,y,yaw', got ''"),
            ("0.0,0,0,0\n", "first line must be 'timestamp,x,y,yaw', got '0.0,0,0,0'"),
            ("timestamp,x,y,yaw\n", "no data"),
            ("timestamp,x,y,yaw\n0,0,0\n", "line 2: expected 4 values"),
            ("timestamp,x,y,yaw\n0,0,0,\n", "line 2: '' is not a number"),
            ("timestamp,x,y,yaw\n0,0,inf,0\n", "line 2: a value is not finite"),
            ("timestamp,x,y,yaw\n1,0,0,0\n0,0,0,0\n", "times must increase"),
        ],
    )
    def test_bad_files(self, tmp_path: Path, content: str, message: str) -> None:
        (tmp_path / "o.csv").write_text(content)
        with pytest.raises(SourceError, match=rf"o\.csv.*{message}"):
            read_odometry(tmp_path / "o.csv")

    @pytest.mark.parametrize(
        ("factors", "message"),
        [
            ((1.0, 1.0, 1.0, 1.0), ""),
            ((1.0, -1.0, -1.0, 1.0), ""),
            ((1.0, 1000.0, 1000.0, 1.0), "x, y usually change by"),
            ((1000.0, 1.0, 1.0, 1.0), "rows usually come 100 s apart"),
            ((1.0, 1.0, 1.0, 180.0 / np.pi), "in degrees; give radians"),
        ],
    )
    def test_units(self, tmp_path: Path, factors: tuple[float, ...], message: str) -> None:
        """A bow at half a metre a second, in several units; backwards it is a drive, too."""
        t = 0.1 * np.arange(100)
        bow = np.column_stack([t, 1.2 * np.sin(0.4 * t), 1.2 * (1.0 - np.cos(0.4 * t)), 0.4 * t]) * factors
        np.savetxt(tmp_path / "o.csv", bow, "%.6f", ",", header="timestamp,x,y,yaw", comments="")
        if not message:
            assert read_odometry(tmp_path / "o.csv").at(5.0) == pytest.approx(bow[50, 1:])
            return
        with pytest.raises(SourceError, match=message):
            read_odometry(tmp_path / "o.csv")

    def test_a_rig_that_spins_while_it_goes_aside_is_no_table_in_degrees(self, tmp_path: Path) -> None:
        t = 0.1 * np.arange(300)
        spin = np.column_stack([t, 0.5 * t, 0.0 * t, 3.0 * t])
        np.savetxt(tmp_path / "o.csv", spin, "%.6f", ",", header="timestamp,x,y,yaw", comments="")
        assert read_odometry(tmp_path / "o.csv").at(29.0) == pytest.approx((14.5, 0.0, 87.0))
