"""Results are written whole or not at all, never over others, and a full disk is said."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import cv2
import numpy as np
import pytest

from facetcam.errors import FacetcamError, OutputError
from facetcam.io.outputs import LineWriter, atomic_write, fresh_folder
from facetcam.io.ply import write_ply

FULL = Path("/dev/full")  # every write fails with "no space left"
needs_full = pytest.mark.skipif(not FULL.exists(), reason="no /dev/full on this system")


class TestFolder:
    def test_is_made_with_its_parents(self, tmp_path: Path) -> None:
        assert fresh_folder(tmp_path / "a" / "b").is_dir()

    def test_an_existing_one_is_refused_and_untouched(self, tmp_path: Path) -> None:
        (tmp_path / "old").mkdir()
        (tmp_path / "old" / "precious").write_text("1")
        with pytest.raises(OutputError, match="old: exists already"):
            fresh_folder(tmp_path / "old")
        assert (tmp_path / "old" / "precious").read_text() == "1"

    def test_a_file_in_the_way(self, tmp_path: Path) -> None:
        (tmp_path / "file").write_text("1")
        with pytest.raises(OutputError, match="Not a directory"):
            fresh_folder(tmp_path / "file" / "out")


class TestAtomicWrite:
    def test_replaces_and_leaves_nothing_beside(self, tmp_path: Path) -> None:
        path = tmp_path / "a.txt"
        atomic_write(path, "old")
        atomic_write(path, b"new")
        assert path.read_text() == "new"
        assert list(tmp_path.iterdir()) == [path]

    def test_has_the_usual_permissions(self, tmp_path: Path) -> None:
        atomic_write(tmp_path / "a", "1")
        (tmp_path / "b").write_text("1")
        modes = [stat.S_IMODE((tmp_path / name).stat().st_mode) for name in "ab"]
        assert modes[0] == modes[1]

    def test_a_failure_keeps_the_old_file(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        path = tmp_path / "a.txt"
        atomic_write(path, "old")

        def no_space(_: int) -> None:
            raise OSError(28, os.strerror(28))

        monkeypatch.setattr(os, "fsync", no_space)
        with pytest.raises(OutputError, match=r"a\.txt: cannot be written \(No space left on device\)"):
            atomic_write(path, "new")
        assert path.read_text() == "old"
        assert list(tmp_path.iterdir()) == [path]

    def test_a_missing_folder(self, tmp_path: Path) -> None:
        with pytest.raises(OutputError, match="No such file"):
            atomic_write(tmp_path / "none" / "a.txt", "1")


class TestLineWriter:
    def test_lines_are_on_disk_at_once(self, tmp_path: Path) -> None:
        with LineWriter(tmp_path / "a.csv") as lines:
            for count in range(1, 4):
                lines.write(f"{count}")
                assert len((tmp_path / "a.csv").read_text().splitlines()) == count

    def test_an_existing_file_is_not_touched(self, tmp_path: Path) -> None:
        (tmp_path / "a.csv").write_text("old")
        with pytest.raises(OutputError, match="File exists"):
            LineWriter(tmp_path / "a.csv")
        assert (tmp_path / "a.csv").read_text() == "old"

    @needs_full
    def test_a_full_disk(self, tmp_path: Path) -> None:
        with LineWriter(tmp_path / "a.csv") as lines:
            lines.write("kept")
            with FULL.open("w") as full:
                os.dup2(full.fileno(), lines._file.fileno())
            with pytest.raises(OutputError, match=r"a\.csv: cannot be written \(No space left on device\)"):
                lines.write("lost")
        assert (tmp_path / "a.csv").read_text() == "kept\n"


class TestPly:
    def test_opencv_reads_it_back(self, tmp_path: Path) -> None:
        rng = np.random.default_rng(0)
        points = rng.normal(size=(200, 3)) * 10
        colours = rng.integers(0, 256, (200, 3), dtype=np.uint8)
        write_ply(tmp_path / "a.ply", points, colours)
        vertices, _, rgb = cv2.loadPointCloud(str(tmp_path / "a.ply"))
        np.testing.assert_allclose(np.squeeze(vertices), points, rtol=1e-6)
        assert rgb is not None

    def test_layout_as_the_format_defines_it(self, tmp_path: Path) -> None:
        write_ply(tmp_path / "a.ply", [[1.0, -2.0, 0.5]], [[255, 128, 0]])
        header, body = (tmp_path / "a.ply").read_bytes().split(b"end_header\n")
        assert b"format binary_little_endian 1.0\nelement vertex 1\n" in header
        assert body == b"\x00\x00\x80\x3f\x00\x00\x00\xc0\x00\x00\x00\x3f\xff\x80\x00"

    def test_an_empty_cloud_is_a_file(self, tmp_path: Path) -> None:
        write_ply(tmp_path / "a.ply", np.empty((0, 3)), np.empty((0, 3), np.uint8))
        assert b"element vertex 0\n" in (tmp_path / "a.ply").read_bytes()

    def test_bad_arrays(self, tmp_path: Path) -> None:
        with pytest.raises(FacetcamError, match="2 points but 1 colours"):
            write_ply(tmp_path / "a.ply", np.zeros((2, 3)), np.zeros((1, 3), np.uint8))
        with pytest.raises(FacetcamError, match="not finite"):
            write_ply(tmp_path / "a.ply", np.full((1, 3), np.nan), np.zeros((1, 3), np.uint8))
