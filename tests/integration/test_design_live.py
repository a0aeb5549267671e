"""The design page: it follows its sliders, refuses in words, saves, and shows in a real browser."""

from __future__ import annotations

import itertools
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from facetcam.design.areas import view_areas
from facetcam.design.family import make_rig
from facetcam.design.spec import Body, CameraSpec, DesignSpec, Family, read_spec
from facetcam.errors import ConfigError
from facetcam.pipelines.design_live import open_live_page, save_design
from facetcam.rig import Rig
from facetcam.viz.design_live import LivePage
from facetcam.viz.design_live_pictures import rgb, sensor_picture
from facetcam.viz.palette import view_colour

pytest.importorskip("viser")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
WAIT = 60.0  # seconds, on a machine that does much else
SOON = 0.2  # seconds after which the page has followed a slider
FIVE_FACES = Path(__file__).parents[2] / "examples" / "designs" / "five-face-pyramid.yaml"


@pytest.fixture
def page(tmp_path: Path) -> Iterator[LivePage]:
    opened = open_live_page("preset:ryu", tmp_path / "saved", 8230)
    yield opened
    opened.stop()


def move(page: LivePage, name: str, value: float) -> None:
    """Move a slider, and wait until the page has followed."""
    before, deadline = page.redraws, time.monotonic() + WAIT
    page.sliders[name].value = value
    while page.redraws == before:
        assert time.monotonic() < deadline, "the page did not follow"
        time.sleep(0.01)


def test_the_page_follows_its_sliders_and_saves_what_it_shows(page: LivePage, tmp_path: Path) -> None:
    words = page._words.content
    move(page, "tilt_degrees", 35.0)
    assert page.spec.family is not None and page.spec.family.tilt_degrees == 35.0
    assert page._words.content != words and "of the horizon" in page._words.content
    move(page, "depth", 75.0)
    assert "Cannot be built" in page._words.content and "cross each other" in page._words.content
    page.save()  # the last rig that can be built
    saved = read_spec(tmp_path / "saved" / "design-1.yaml")
    assert saved.family is not None and saved.family.tilt_degrees == 35.0 and saved.family.depth == 0.06
    expected = make_rig(saved)
    loaded = Rig.load(tmp_path / "saved" / "rig-1.yaml")
    for name, mirror in expected.mirrors.items():
        np.testing.assert_allclose(loaded.mirrors[name].polygon, mirror.polygon, atol=1e-12)
    page.save()
    assert (tmp_path / "saved" / "rig-2.yaml").exists()


@pytest.mark.parametrize("design", ["preset:ryu", FIVE_FACES], ids=["ryu", "five faces"])
def test_the_page_follows_soon(design: Path | str, tmp_path: Path) -> None:
    page = open_live_page(design, tmp_path / "saved", 8240)
    page.stop_following()  # it is redrawn here, so that the processor time is that of one redraw
    spent = []
    for faces, tilt, focal in itertools.product((4, 5, 6), (30.0, 40.0, 45.0), (300.0, 1250.0)):
        page.faces.value, page.sliders["tilt_degrees"].value = faces, tilt
        page._fit.value, page.focal.value = False, focal
        redrawn = min(thread_time_of(page.redraw) for _ in range(2))
        if "Cannot be built" not in page._words.content:
            spent.append(redrawn)
    page.stop()
    assert len(spent) >= 6
    print(f"{len(spent)} rigs, redraw {np.median(spent):.3f} s, worst {max(spent):.3f} s of processor time")
    assert max(spent) < SOON


def thread_time_of(work: Callable[[], None]) -> float:
    begin = time.thread_time()
    work()
    return time.thread_time() - begin


@pytest.mark.parametrize(
    "lens", [CameraSpec(), CameraSpec(model="kannala-brandt", distortion=(0.05, 0.0, 0.0, 0.0))]
)
def test_the_sensor_picture_is_that_of_the_traced_pixels(lens: CameraSpec) -> None:
    rig = make_rig(DesignSpec(family=Family(False, 5, 0.06, 40.0, 0.12, None), camera=lens))
    picture = sensor_picture(rig, view_areas(rig))
    labels = cv2.resize(rig.labels(), picture.shape[1::-1], interpolation=cv2.INTER_NEAREST)
    for index in range(len(rig.views)):
        drawn = (picture == rgb(view_colour(index))).all(axis=2)
        own = (labels == index).astype(np.uint8)
        # Away from the edge, every pixel agrees.
        assert drawn[cv2.erode(own, np.ones((5, 5))) == 1].all()
        assert not drawn[cv2.dilate(own, np.ones((5, 5))) == 0].any()


def test_a_rig_without_parameters_has_no_sliders(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="give a family"):
        open_live_page("preset:table", tmp_path)
    tight = replace(read_spec("preset:ryu"), body=Body(0.2, 0.2, 0.2))
    with pytest.raises(Exception, match="stands in mirror"):
        save_design(tight, tmp_path)


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="no chromium")
def test_a_browser_shows_the_rig_and_its_sensor(page: LivePage, tmp_path: Path) -> None:
    def seen(name: str) -> np.ndarray:
        switches = (
            "--headless --no-sandbox --disable-quic --no-first-run --disable-background-networking "
            "--disable-component-update --disable-sync --use-angle=swiftshader --enable-unsafe-swiftshader "
            f"--user-data-dir={tmp_path / 'profile'} --window-size=1300,900 --virtual-time-budget=15000"
        )
        shot = tmp_path / name
        command = [str(CHROMIUM), *switches.split(), f"--screenshot={shot}", page.address]
        subprocess.run(command, check=True, capture_output=True, timeout=200)
        image = cv2.imread(str(shot))
        assert image is not None
        return image[..., ::-1]

    def panel_share(image: np.ndarray, colour: tuple[int, int, int]) -> float:
        """Share of the controls' side of the page in one colour of the sensor picture."""
        near = np.abs(image[:, 950:].astype(int) - colour).max(axis=2) < 12
        return float(near.mean())

    first = seen("first.png")
    left = first[:, :950].astype(int)
    assert np.mean(np.ptp(left, axis=2) > 40) > 0.004  # coloured mirrors and rays in the scene
    shares = [panel_share(first, rgb(view_colour(i))) for i in range(4)]
    assert min(shares) > 0.003
    move(page, "aspect", 1.0)  # square: the side views grow
    second = seen("second.png")
    grown = [panel_share(second, rgb(view_colour(i))) for i in range(4)]
    assert grown[0] < 0.9 * shares[0] and not np.array_equal(first[:, :950], second[:, :950])
