"""The command line as a whole: help, version, usage, and the small commands."""

from __future__ import annotations

import csv
import io
import json
import re
import resource
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from command import Facetcam, only_line
from films import moving, textured, write_folder

from facetcam import __version__
from facetcam.features import SIICF
from facetcam.io.trajectories import write_tum
from facetcam.pipelines import detect


class TestTheWhole:
    def test_help_is_quick_and_lists_the_commands(self) -> None:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        command = [sys.executable, "-m", "facetcam", "--help"]
        result = subprocess.run(command, capture_output=True, text=True, check=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        # Time of the processor: other work on the machine is no fault of ours.
        assert after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime < 0.5
        for command in ("slam", "detect", "evaluate"):
            assert command in result.stdout

    def test_help_loads_nothing_heavy(self) -> None:
        code = "import sys, facetcam.cli; print(*sys.modules)"
        result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        assert not {"cv2", "av", "scipy", "matplotlib", "pycolmap", "rich"} & set(result.stdout.split())

    def test_version(self, facetcam: Facetcam) -> None:
        assert facetcam("--version").stdout == f"facetcam {__version__}\n"

    @pytest.mark.parametrize(
        "arguments",
        [
            ("slan",),
            ("slam",),
            ("slam", "film.mp4"),
            ("slam", "film.mp4", "--rig"),
            ("slam", "film.mp4", "--rig", "rig.yaml", "--fps", "fast"),
            ("slam", "film.mp4", "--rig", "rig.yaml", "--max-frames", "0"),
            ("slam", "film.mp4", "--rig", "rig.yaml", "--no-such-option"),
            ("evaluate", "trajectory", "a.tum"),
            ("evaluate", "trajectory", "a.tum", "b.tum", "--format", "xml"),
        ],
    )
    def test_wrong_usage_is_code_2(self, facetcam: Facetcam, arguments: tuple[str, ...]) -> None:
        line = only_line(facetcam(*arguments), code=2)
        assert re.search(r"; see `facetcam[a-z ]* --help`$", line)

    @pytest.mark.parametrize("arguments", [(), ("map",), ("evaluate",)])
    def test_no_words_at_all_show_the_help(self, facetcam: Facetcam, arguments: tuple[str, ...]) -> None:
        result = facetcam(*arguments)
        assert "Commands:" in result.output and result.exit_code == 2


class TestDetect:
    def test_arrays_and_pictures(self, facetcam: Facetcam, tmp_path: Path) -> None:
        images = [textured(120, 160, seed) for seed in range(2)]
        folder, out = write_folder(tmp_path / "in", images), tmp_path / "out"
        result = facetcam("detect", folder, "--out", out, "--max-features", 50)
        assert result.exit_code == 0, result.output
        assert sorted(path.name for path in out.iterdir()) == [
            "000000.jpg", "000000.npz", "000001.jpg", "000001.npz"
        ]  # fmt: skip
        keypoints, descriptors = SIICF.create(max_features=50).detectAndCompute(images[1])
        with np.load(out / "000001.npz") as arrays:
            assert np.array_equal(arrays["xy"], keypoints.xy)
            assert np.array_equal(arrays["descriptors"], descriptors)
            assert arrays["image"] == "1.png"
        assert 0 < len(keypoints) <= 50

    def test_an_unreadable_image_is_said(self, facetcam: Facetcam, tmp_path: Path) -> None:
        folder = write_folder(tmp_path / "in", moving(3))
        (folder / "1.png").write_bytes(b"")
        result = facetcam("detect", folder, "--out", tmp_path / "out")
        assert result.exit_code == 0, result.output
        assert result.stderr == "facetcam: warning: 1.png skipped: empty file\n"

    def test_bad_input(self, facetcam: Facetcam, tmp_path: Path) -> None:
        folder = write_folder(tmp_path / "in", moving(1))
        assert "no such file" in only_line(facetcam("detect", tmp_path / "none", "--out", tmp_path / "out"))
        line = only_line(facetcam("detect", folder, "--mode", "magic", "--out", tmp_path / "out"))
        assert "mode must be one of robust, paper, got 'magic'" in line
        assert not (tmp_path / "out").exists()
        assert "exists already" in only_line(facetcam("detect", folder, "--out", folder))

    def test_a_full_disk(self, facetcam: Facetcam, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        def full(path: Path, data: bytes) -> None:
            raise OSError(28, "No space left on device", str(path))

        monkeypatch.setattr(detect, "atomic_write", full)
        folder = write_folder(tmp_path / "in", moving(1))
        line = only_line(facetcam("detect", folder, "--out", tmp_path / "out"))
        assert f"{tmp_path / 'out' / '000000.npz'}: No space left on device" in line


@pytest.fixture
def trajectories(tmp_path: Path) -> tuple[Path, Path]:
    """A random walk, and the same ten per cent larger."""
    times = np.arange(30) / 10
    poses = np.tile(np.eye(4), (30, 1, 1))
    poses[:, :3, 3] = np.cumsum(np.random.default_rng(0).normal(0, 0.1, (30, 3)), axis=0)
    write_tum(tmp_path / "truth.tum", times, poses)
    poses[:, :3, 3] *= 1.1
    write_tum(tmp_path / "estimate.tum", times, poses)
    return tmp_path / "estimate.tum", tmp_path / "truth.tum"


class TestEvaluateTrajectory:
    def test_one_result_in_three_formats(self, facetcam: Facetcam, trajectories: tuple[Path, Path]) -> None:
        told = {form: facetcam("evaluate", "trajectory", *trajectories, "--format", form).stdout
                for form in ("text", "csv", "json")}  # fmt: skip
        errors = json.loads(told["json"])
        assert errors["scale_error"] == pytest.approx(0.1)
        assert errors["ate_scaled"]["rmse"] == pytest.approx(0.0, abs=1e-8)
        rows = dict(row for row in csv.reader(io.StringIO(told["csv"])))
        assert float(rows["ate.rmse"]) == errors["ate"]["rmse"]
        assert int(rows["matched"]) == 30
        assert f"{errors['ate']['rmse']:.4f}" in told["text"]
        assert "scale error +10.000 %" in told["text"]

    def test_a_folder_with_tables_and_plots(
        self, facetcam: Facetcam, trajectories: tuple[Path, Path], tmp_path: Path
    ) -> None:
        out = tmp_path / "out"
        result = facetcam("evaluate", "trajectory", *trajectories, "--out", out)
        assert (out / "errors.txt").read_text() == result.stdout
        assert json.loads((out / "errors.json").read_text())["estimated"] == 30
        for name in ("path.svg", "errors.svg"):
            drawing = (out / name).read_text()
            assert ElementTree.fromstring(drawing).tag.endswith("svg")
            assert "var(" not in drawing
        assert "exists already" in only_line(facetcam("evaluate", "trajectory", *trajectories, "--out", out))

    def test_bad_files(self, facetcam: Facetcam, trajectories: tuple[Path, Path], tmp_path: Path) -> None:
        estimate, truth = trajectories
        assert "No such file" in only_line(facetcam("evaluate", "trajectory", tmp_path / "x", truth))
        estimate.write_text("nonsense\n")
        assert "estimate.tum line 1" in only_line(facetcam("evaluate", "trajectory", estimate, truth))
        truth.write_text("9 0 0 0 0 0 0 1\n")
        estimate.write_text("1 0 0 0 0 0 0 1\n")
        assert "on one clock" in only_line(facetcam("evaluate", "trajectory", estimate, truth))
