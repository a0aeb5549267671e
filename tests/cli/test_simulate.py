"""`facetcam simulate`: files, resuming, boards, and what it says of bad input."""

from __future__ import annotations

import json
import pkgutil
import signal
from pathlib import Path

import cv2
import numpy as np
import pytest
from command import Facetcam, only_line
from simulated_rooms import resized, room_quads

from facetcam.calibration import read_boards
from facetcam.geometry import se3
from facetcam.io.sources import open_source
from facetcam.io.trajectories import read_tum, write_tum
from facetcam.pipelines.simulate import run_simulate
from facetcam.pipelines.simulate_inputs import Options
from facetcam.rig import Rig
from facetcam.simulation.meshes import Material, quad

pytest.importorskip("trimesh", reason="pip install facetcam[sim]")

SETTINGS = """
camera: {samples: 1, exposure_time: 0.01, readout: 0.01, vignetting: 0.3}
light:
  lamps:
  - {position: [0.2, 0.1, 1.1], schedule: [{at: 0.2, do: dim}, {at: 0.3, do: flicker}]}
build: {tilt_degrees: 0.3, shift_mm: 0.2}
"""


@pytest.fixture
def studio(tmp_path: Path) -> Path:
    """A folder with a scene, a rig, a path and settings."""
    import trimesh
    from PIL import Image

    scene = trimesh.Scene()
    for corner, right, down, picture in room_quads():
        q = quad(corner, right, down, Material(picture))
        material = trimesh.visual.material.PBRMaterial(baseColorTexture=Image.fromarray(picture[::4, ::4]))
        visual = trimesh.visual.TextureVisuals(uv=q.uv * (1, -1) + (0, 1), material=material)
        scene.add_geometry(trimesh.Trimesh(q.vertices, q.faces, visual=visual, process=False))
    scene.export(tmp_path / "room.glb")
    resized(Rig.load("preset:ryu"), 0.1).save(tmp_path / "rig.yaml")
    (tmp_path / "settings.yaml").write_text(SETTINGS)
    times = np.arange(5) / 10
    poses = np.array([se3.exp([0, 0, 0.2 * t, 0.3 * t, 0, 0]) for t in times])
    write_tum(tmp_path / "path.tum", times + 50.0, poses)
    (tmp_path / "points.csv").write_text("x,y\n-0.5,0\n0,0.2\n0.5,0\n")
    return tmp_path


def arguments(studio: Path, out: str = "out", path: str = "trajectory") -> list[object]:
    file = {"trajectory": "path.tum", "drive": "points.csv"}[path]
    rest = ["--settings", studio / "settings.yaml", "--out", studio / out]
    return ["simulate", studio / "room.glb", "--rig", studio / "rig.yaml", f"--{path}", studio / file, *rest]


def test_a_film_comes_with_its_truth(studio: Path, facetcam: Facetcam) -> None:
    result = facetcam(*arguments(studio), "--depth")
    assert result.exit_code == 0, result.output
    out = studio / "out"
    with open_source(out / "film.mp4") as film:
        frames = [frame.image for frame in film]
    assert len(frames) == 5
    assert frames[0].shape == (120, 160, 3)
    times, poses = read_tum(out / "truth.tum")
    assert np.allclose(times, np.arange(5) / 10)
    assert np.allclose(poses, read_tum(studio / "path.tum")[1], atol=1e-8)
    drawn, true = Rig.load(out / "rig_nominal.yaml"), Rig.load(out / "rig_true.yaml")
    assert drawn.digest == Rig.load(studio / "rig.yaml").digest != true.digest
    note = json.loads((out / "simulation.json").read_text())
    cosine = abs(drawn.mirrors["front"].normal @ true.mirrors["front"].normal)
    stated = np.radians(note["off_the_drawing"]["front"]["turn_degrees"])
    assert np.cos(stated) == pytest.approx(cosine, abs=1e-9)
    depth = cv2.imread(str(out / "depth" / "000000.png"), cv2.IMREAD_UNCHANGED)
    assert depth.dtype == np.uint16
    assert 500 < np.median(depth[true.labels() >= 0]) < 3000
    assert len((out / "odometry.csv").read_text().splitlines()) == 6
    assert "data:image" in (out / "report.html").read_text()
    assert not (out / "frames").exists()


def test_a_run_cut_short_goes_on_to_the_same_frames(studio: Path) -> None:
    options = Options(
        studio / "room.glb", studio / "rig.yaml", studio / "path.tum", settings=studio / "settings.yaml"
    )
    run_simulate(options, studio / "whole", png=True, threads=1)

    class Halt(Exception):
        pass

    class Stage:
        def __init__(self, name: str) -> None:
            self.name = name

        def __enter__(self):
            def progress(done: int, total: int | None) -> None:
                if self.name == "frames" and done == 2:
                    raise Halt

            return progress

        def __exit__(self, *error: object) -> None:
            return None

    with pytest.raises(Halt):
        run_simulate(options, studio / "cut", png=True, stage=Stage)
    assert len(list((studio / "cut" / "frames").iterdir())) == 2
    untouched = (studio / "cut" / "frames" / "000000.png").stat().st_mtime_ns
    run_simulate(options, studio / "cut", png=True, resume=True, threads=3)
    assert (studio / "cut" / "frames" / "000000.png").stat().st_mtime_ns == untouched
    for k in range(5):
        one, other = ((studio / name / "frames" / f"{k:06d}.png").read_bytes() for name in ("whole", "cut"))
        assert one == other, k


@pytest.mark.parametrize(("where", "left"), [("mesh_light.openness", 0), ("sensor.Sensor.develop", 2)])
def test_ctrl_c_strikes_at_once_and_the_run_goes_on(
    studio: Path, facetcam: Facetcam, monkeypatch: pytest.MonkeyPatch, where: str, left: int
) -> None:
    """While light is baked there are no steps; a frame takes long at full size."""
    calls, place = [], f"facetcam.simulation.{where}"
    plain = pkgutil.resolve_name(f"facetcam.simulation.{where.split('.')[0]}:{where.split('.', 1)[1]}")

    def struck(*given: object) -> object:
        calls.append(where)
        if len(calls) == left + 1:
            signal.raise_signal(signal.SIGINT)
        return plain(*given)

    monkeypatch.setattr(place, struck)
    result = facetcam(*arguments(studio), "--png")
    assert result.exit_code == 130, result.output
    assert len(calls) == left + 1
    assert "stopped" in result.stderr
    frames = studio / "out" / "frames"
    assert len(list(frames.glob("*.png"))) == left
    resumed = facetcam(*arguments(studio), "--png", "--resume")
    assert resumed.exit_code == 0, resumed.output
    whole = facetcam(*arguments(studio, "whole"), "--png")
    assert whole.exit_code == 0, whole.output
    for file in sorted((studio / "whole" / "frames").iterdir()):
        assert file.read_bytes() == (frames / file.name).read_bytes()


def test_boards_are_seen_in_every_view(studio: Path, facetcam: Facetcam) -> None:
    """OpenCV, which knows nothing of the simulator, reads the markers where the truth projects them."""
    resized(Rig.load("preset:ryu"), 0.5).save(studio / "large.yaml")
    call = arguments(studio, "boards")
    call[3] = studio / "large.yaml"
    cut = facetcam(*call, "--boards", "2", "--max-frames", "1")
    assert cut.exit_code == 1 and "--max-frames is for films" in cut.stderr
    result = facetcam(*call, "--boards", "2")
    assert result.exit_code == 0, result.output
    out = studio / "boards"
    boards = read_boards(out / "boards.yaml").boards
    truth = json.loads((out / "calibration_truth.json").read_text())
    rig, seen, errors = Rig.load(out / "rig_true.yaml"), set(), []
    clear = rig.mask(10)
    detector = cv2.aruco.ArucoDetector(boards[0].markers_of_dictionary)
    for k, pose in enumerate(np.array(truth["T_world_rig"])):
        image = cv2.imread(str(out / "frames" / f"{k:06d}.png"))
        corners, ids, _ = detector.detectMarkers(image)
        for quad_, marker in zip(corners, ids.ravel()):
            board = next(b for b in boards if marker in b.ids)
            T = se3.inverse(pose) @ np.array(truth["T_world_board"][board.name])
            points = se3.transform(T, board.marker_corners[marker - board.first_id])
            for view in rig.view_names:
                pixels, visible = rig.project(view, points)
                if visible.all() and np.linalg.norm(pixels - quad_[0], axis=1).max() < 4:
                    seen.add(view)
        grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        for view in rig.view_names:  # the corners of the squares, to a fraction of a pixel
            for board in boards:
                T = se3.inverse(pose) @ np.array(truth["T_world_board"][board.name])
                pixels, visible = rig.project(view, se3.transform(T, board.points))
                rows, columns = np.rint(pixels[visible][:, ::-1]).astype(int).T
                start = pixels[visible][clear[rows, columns] > 0].astype(np.float32).reshape(-1, 1, 2)
                if len(start):
                    found = cv2.cornerSubPix(grey, start.copy(), (4, 4), (-1, -1), (3, 40, 1e-3))
                    errors += np.linalg.norm(found - start, axis=2).ravel().tolist()
    assert seen == set(rig.view_names)
    assert len(errors) > 40
    assert np.median(errors) < 0.1


def test_waypoints_make_a_film_too(studio: Path, facetcam: Facetcam) -> None:
    result = facetcam(*arguments(studio, path="drive"), "--height", "0", "--png", "--max-frames", "3")
    assert result.exit_code == 0, result.output
    assert len(list((studio / "out" / "frames").iterdir())) == 3


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (["--drive", "points.csv"], "either --trajectory or --drive"),
        (["--out", "."], "exists already"),
        (["--settings", "typo.yaml"], "did you mean 'samples'"),
        (["--rig", "absent.yaml"], "absent.yaml"),
        (["--scale", "0.001"], "is no room"),
        (["--scale", "1e9"], "is no room"),
        (["--settings", "wide.yaml"], "camera: aperture is 100; it must be between 0 and 0.1"),
        (["--settings", "dark.yaml"], "lamp: power is -1; it must be between"),
        (["--trajectory", "gap.tum"], "gap.tum: 1e+09 s make"),
        (["--trajectory", "instant.tum"], "its 2 poses take 1e-09 s, less than one of 1000 frames"),
        (["--resume"], "no simulation to resume"),
    ],
)
def test_bad_input_is_refused_in_one_line(
    studio: Path, facetcam: Facetcam, change: list[str], says: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(studio)
    (studio / "typo.yaml").write_text("camera: {smaples: 3}\n")
    (studio / "wide.yaml").write_text("camera: {aperture: 100}\n")
    (studio / "dark.yaml").write_text("light: {lamps: [{position: [0, 0, 1], power: -1}]}\n")
    (studio / "gap.tum").write_text("".join(f"{t} 0 0 0 0 0 0 1\n" for t in (0, 0.1, 0.2, 1e9)))
    (studio / "instant.tum").write_text("0 0 0 0 0 0 0 1\n0.000000001 0.1 0 0 0 0 0 1\n")
    result = facetcam(*arguments(studio), *change)
    assert result.exit_code == 1
    assert says in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1


def test_a_drive_over_before_its_second_frame_is_refused(studio: Path, facetcam: Facetcam) -> None:
    line = only_line(facetcam(*arguments(studio, path="drive"), "--speed", "1e12"))
    assert "m at 1e+12 m/s end before the second of 10 frames/s; go slower" in line


def test_odd_paths_are_said_and_still_filmed(studio: Path, facetcam: Facetcam) -> None:
    away = np.array([se3.from_rotation_translation(np.eye(3), (9.0, 0, 0))] * 2)
    write_tum(studio / "path.tum", np.arange(2) / 10, away)
    result = facetcam(*arguments(studio), "--png")
    assert result.exit_code == 0
    assert "outside the scene" in result.stderr
