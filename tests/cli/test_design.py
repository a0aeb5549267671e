"""`facetcam design`: its files, the shipped designs, and its manners with bad input."""

from __future__ import annotations

import json
import re
import signal
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from command import Facetcam, only_line

from facetcam.rig import Rig

DESIGNS = Path(__file__).parents[2] / "examples" / "designs"
FEW = "tolerance: {builds: 3, depths: [0.5, 2.0]}\n"


@pytest.fixture
def drawing(tmp_path: Path) -> Path:
    path = tmp_path / "drawing.yaml"
    path.write_text("family: {}\ncamera: {width: 400, height: 300, focal: 312}\n" + FEW)
    return path


def test_a_drawing_becomes_a_rig_and_its_report(facetcam: Facetcam, drawing: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    result = facetcam("design", drawing, "--out", out)
    assert result.exit_code == 0, result.output
    assert sorted(p.name for p in out.iterdir()) == ["design.json", "design.yaml", "report.html", "rig.yaml"]
    assert Rig.load(out / "rig.yaml").view_names == ("front", "left", "back", "right")
    found = json.loads((out / "design.json").read_text())
    assert found["horizon_share"] == pytest.approx(0.324, abs=0.005)
    assert set(found["views"]) == {"front", "left", "back", "right"}
    centres = np.array([view["centre"] for view in found["views"].values()])
    about_mean = np.sqrt(np.sum(centres.var(axis=0)))
    assert found["centres_spread_rms"] == pytest.approx(about_mean, rel=1e-9)
    page = (out / "report.html").read_text()
    assert page.count("<svg") == 10 and "not one single view point" in page
    assert "it shifts points at 0.5 m by" in page  # of the depths of the drawing, the nearest to a metre
    assert not re.search(r"\bnan\b|\binf\b|mathdefault", page)
    again = facetcam("design", out / "design.yaml", "--out", tmp_path / "again", "--no-tolerance")
    assert again.exit_code == 0, again.output
    assert (tmp_path / "again" / "rig.yaml").read_text() == (out / "rig.yaml").read_text()


def test_what_the_workshop_needs(facetcam: Facetcam, drawing: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    result = facetcam("design", drawing, "--make", "--no-tolerance", "--out", out)
    assert result.exit_code == 0, result.output
    names = {path.name for path in (out / "make").iterdir()}
    mirrors = ("base", "front", "left", "back", "right")
    drawn = {f"{mirror}.{kind}" for mirror in mirrors for kind in ("svg", "dxf")}
    assert names == drawn | {"holder-facets.stl", "holder-base.stl", "parts.csv"}
    assert (out / "make" / "parts.csv").read_text().count("\n") == 1 + 5 + 1 + 2


def test_a_search_writes_what_it_found(facetcam: Facetcam, drawing: Path, tmp_path: Path) -> None:
    drawing.write_text(drawing.read_text() + "search: {generations: 3, population: 4}\n")
    out = tmp_path / "out"
    result = facetcam(
        "design", drawing, "--search", "--goal", "coverage=1,baseline=0.2", "--no-tolerance", "--out", out
    )
    assert result.exit_code == 0, result.output
    found = json.loads((out / "design.json").read_text())["search"]
    weighed = {k: found[k]["coverage"] + 0.2 * found[k]["baseline"] / 0.1 for k in ("best", "start")}
    assert weighed["best"] >= weighed["start"]
    assert "The search" in (out / "report.html").read_text()


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(p.name for p in DESIGNS.glob("*.yaml") if "rig" not in p.name))
def test_the_shipped_designs(facetcam: Facetcam, name: str, tmp_path: Path) -> None:
    result = facetcam("design", DESIGNS / name, "--no-tolerance", "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    found = json.loads((tmp_path / "out" / "design.json").read_text())
    assert all(view["solid_angle"] > 0.01 for view in found["views"].values())
    if name == "stereo-adapter.yaml":
        assert found["overlap_share"] > 0.01  # what a stereo pair is for
        centres = np.array([view["centre"] for view in found["views"].values()])
        assert np.linalg.norm(centres[0] - centres[1]) == pytest.approx(0.047, abs=0.001)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("family: {radios: 0.1}", "did you mean 'radius'"),
        ("family: {depth: 0.07}", "cross each other"),
        ("family: {camera_height: 0.079}\ncamera: {focal: 1250}", "stands in mirror"),
        ("family: {depth: 0}", "depth 0 have no area"),
        ("family: {radius: 0}", "radius is 0; it must be above zero"),
        ("family: {radius: 67.5}", "radius is 67.5 m, no mirror's size; give metres, 0.0675 for 67.5 mm"),
        ("camera: {focal: 20}\nfamily: {faces: 4}", "longer focal length, or --no-tolerance"),
        ("family: {faces: 2}", "faces make a rig, got 2"),
        ("family: {camera_height: 0.11}\ncamera: {focal: 700}", "opening of 60 x 15 mm is too small"),
        ("family: {}\nrig: preset:ryu", "either family"),
        ("{}", "either family"),
        ("rig: nowhere.yaml", "nowhere.yaml"),
        ("family: {}\ncamera: {focal: -3}", "must be positive"),
        ("family: {}\noptics: {f_number: 0}", "f_number is 0; it must be between"),
        ("family: {}\nbody: {width: -1}", "width is -1; it must be between"),
        ("family: {}\nsearch: {goal: {coverage: -1}}", "zero or more"),
        ("family: {}\nsearch: {envelope: [0, 0.1, 0.1]}", "envelope is 0; it must be between"),
        ("family: {}\nsearch: {generations: 0}", "generations is 0; it must be between"),
        ("family: {}\nsearch: {population: 1000000000}", "population is 1e+09"),
        ("family: {}\nmaking: {kerf_mm: 80}", "kerf_mm is 80; it must be between 0 and 10"),
        ("family: {}\ntolerance: {depths: [1.0e-12]}", "depths is 1e-12"),
        ("family: {}\ntolerance: {tilt_arcmin: 1.0e+6}", "tilt_arcmin is 1e+06"),
        ("family: {}\nsearch: {band_degrees: 0}", "band_degrees"),
        ("family: {tilt_degrees: 0.01}", "tilted by 0.01 degrees are none; give 1 to 89"),
        ("family: 3", "expected keys"),
        ("- 1", "expected keys"),
        ("family: {fold: false, depth: null, aspect: 1, camera_height: .nan}", "finite"),
    ],
)
def test_bad_drawings_are_one_line(facetcam: Facetcam, text: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "bad.yaml").write_text(text)
    line = only_line(facetcam("design", tmp_path / "bad.yaml", "--out", tmp_path / "out"))
    assert words in line
    assert not (tmp_path / "out").exists()


def test_a_camera_without_mirrors_is_a_rig_of_one_view_and_one_without_views_is_none(
    facetcam: Facetcam, tmp_path: Path
) -> None:
    rig = Rig.load("preset:ryu")
    upright = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
    bare, none = tmp_path / "bare.yaml", tmp_path / "none.yaml"
    Rig(rig.camera, upright).save(bare)
    result = facetcam("design", bare, "--no-tolerance", "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    across = 2 * np.arctan(rig.camera.width / 2 / rig.camera.fx)
    found = json.loads((tmp_path / "out" / "design.json").read_text())
    assert found["horizon_share"] == pytest.approx(across / (2 * np.pi), abs=0.002)
    none.write_text(bare.read_text().split("views:")[0] + "views: {}\n")
    line = only_line(facetcam("design", none, "--out", tmp_path / "never"))
    assert "none.yaml: views: a rig takes 1 to" in line


def test_bad_wishes_are_one_line(facetcam: Facetcam, drawing: Path, tmp_path: Path) -> None:
    for goal, words in (
        ("coverige", "not one of"),
        ("coverage=much", "not a number"),
        ("coverage=-1", "zero or"),
    ):
        line = only_line(facetcam("design", drawing, "--search", "--goal", goal, "--out", tmp_path / "out"))
        assert words in line
    assert facetcam("design", drawing, "--goal", "coverage").exit_code == 2
    line = only_line(facetcam("design", "preset:table", "--search", "--out", tmp_path / "out"))
    assert "give a family" in line
    line = only_line(facetcam("design", tmp_path / "none.yaml", "--out", tmp_path / "out"))
    assert "cannot be read" in line


@pytest.mark.parametrize(
    ("module", "function", "more"), [("search", "evaluate", "--search"), ("tolerance", "_moved", "")]
)
def test_ctrl_c_strikes_amid_a_step_and_leaves_nothing(
    facetcam: Facetcam,
    monkeypatch: pytest.MonkeyPatch,
    drawing: Path,
    tmp_path: Path,
    module: str,
    function: str,
    more: str,
) -> None:
    calls = []

    def struck(*given: object) -> None:
        calls.append(given)
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(import_module(f"facetcam.design.{module}"), function, struck)
    result = facetcam("design", drawing, *more.split(), "--out", tmp_path / "run")
    assert result.exit_code == 130, result.output
    assert len(calls) == 1
    assert result.stderr.startswith("facetcam: stopped")
    assert not (tmp_path / "run").exists()
