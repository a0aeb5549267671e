"""The report pages: self-contained, truthful in words, sensible when a run was empty or cut short."""

from __future__ import annotations

import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from facetcam.errors import OutputError
from facetcam.viz import (
    Check,
    DemoReport,
    Picture,
    SlamReport,
    Truth,
    UnwrapReport,
    write_demo_report,
    write_slam_report,
    write_unwrap_report,
)
from facetcam.viz.figures import broken, ground
from facetcam.viz.palette import view_bgr
from facetcam.viz.pictures import draw_points
from facetcam.viz.wording import verdict

FRAMES = 40


class Page(HTMLParser):
    """Text, tags and outside addresses of a page; unclosed or crossed tags are noted."""

    VOID = frozenset({"meta", "img", "br", "wbr", "link", "path", "use", "rect", "image", "circle"})

    def __init__(self, html: str) -> None:
        super().__init__()
        self.text, self.addresses, self.images = "", [], 0
        self.open: list[str] = []
        self.crossed: list[str] = []
        self.feed(html)
        self.close()

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.addresses += [v for k, v in attributes if k in ("src", "href", "xlink:href") and v]
        self.images += tag == "img"
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.addresses += [v for k, v in attributes if k in ("src", "href", "xlink:href") and v]

    def handle_endtag(self, tag: str) -> None:
        if tag in self.VOID:
            return
        if not self.open or self.open.pop() != tag:
            self.crossed.append(tag)

    def handle_data(self, data: str) -> None:
        self.text += data


@pytest.fixture
def report() -> SlamReport:
    rng = np.random.default_rng(7)
    times = np.arange(FRAMES) / 10
    positions = np.column_stack([np.cos(times), np.sin(times), np.zeros(FRAMES)])
    inliers = rng.integers(10, 60, (FRAMES, 2))
    image = np.full((120, 160, 3), 90, np.uint8)
    return SlamReport(
        title="hall.mp4",
        view_names=("front", "back"),
        times=times,
        statuses=["STARTING"] * 4 + ["TRACKING"] * 36,
        predicted=inliers + 5,
        inliers=inliers,
        tracked=FRAMES,
        metric=True,
        scale_sigma=0.008,
        pose_times=times,
        positions=positions,
        keyframes=positions[::8],
        cloud=rng.normal(0, 2, (300, 3)),
        timing={"corners": rng.uniform(0.01, 0.02, FRAMES), "never": []},
        pictures=[Picture("frame 3", image, np.array([[20.0, 30.0]]), np.array([1]))],
        truth=Truth(
            positions + np.array([0.0, 0.03, 0.0]),
            np.full(FRAMES, 0.03),
            ate=0.03,
            ate_scaled=0.012,
            with_scale=False,
        ),
        facts={"speed": "12 frames/s", "source": "/films/<2nd>/hall.mp4"},
    )


@pytest.fixture
def empty(report: SlamReport) -> SlamReport:
    nothing = np.empty((0, 2), int)
    return SlamReport(
        "black.mp4", report.view_names, np.empty(0), [], nothing, nothing, 0, metric=False, scale_sigma=np.inf
    )


def read(path: Path) -> Page:
    page = Page(path.read_text())
    assert page.open == [] and page.crossed == []
    assert [a for a in page.addresses if not a.startswith(("data:image/", "#"))] == []
    return page


def test_slam_page_is_whole_and_needs_no_other_file(report: SlamReport, tmp_path: Path) -> None:
    write_slam_report(report, tmp_path / "report.html")
    page = read(tmp_path / "report.html")
    for words in ("hall.mp4", "The path from above", "Distance to the truth", "12 frames/s", "frame 3"):
        assert words in page.text
    assert "root mean square 3.00 cm" in page.text  # a constant offset of 3 cm
    assert page.images == 1
    html = (tmp_path / "report.html").read_text()
    assert "/<wbr>films/<wbr>&lt;2nd&gt;/<wbr>hall.mp4" in html  # a long path is broken where it reads well
    assert html.count("<svg") == 4 and "prefers-color-scheme: dark" in html
    assert not re.search("#0[147]0[258]0[369]", html)  # every mark became a colour of the page


def test_maps_that_never_met_have_panels_of_their_own(report: SlamReport, tmp_path: Path) -> None:
    way = report.pose_times, report.positions
    several = replace(report, apart={f"map {i}: 40 poses": way for i in (1, 2, 3, 4)})
    write_slam_report(several, tmp_path / "report.html")
    text = read(tmp_path / "report.html").text
    assert "Other maps of this run" in text and "map 4: 40 poses" in text
    assert "tracked in 5 maps that never met; lengths" in verdict(several)


def test_no_line_is_drawn_where_frames_are_missing() -> None:
    times = np.array([0.0, 0.1, 0.2, 1.2, 1.3, 1.4])
    rows = broken(times, np.arange(6))
    np.testing.assert_array_equal(rows, [0, 1, 2, np.nan, 3, 4, 5])
    for even in (times[:3], times[:1], times[:0]):
        np.testing.assert_array_equal(broken(even, even), even)


def test_the_same_run_gives_the_same_page(report: SlamReport, tmp_path: Path) -> None:
    write_slam_report(report, tmp_path / "a.html")
    write_slam_report(report, tmp_path / "b.html")
    assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()


def test_demo_page_shows_views_and_missed_checks(report: SlamReport, tmp_path: Path) -> None:
    picture = report.pictures[0]
    checks = [Check("path error", "3 cm", "<= 2 cm", False), Check("views", "40 dB", ">= 35 dB", True)]
    write_demo_report(DemoReport(report, picture, [picture, picture], checks), tmp_path / "demo.html")
    page = read(tmp_path / "demo.html")
    assert page.images == 4
    assert page.text.count("missed") == 1 and page.text.count("✓") == 1


def test_contact_sheet(report: SlamReport, tmp_path: Path) -> None:
    sheet = UnwrapReport("hall.mp4", [report.pictures * 2] * 3, facts={"frames": "3"})
    write_unwrap_report(sheet, tmp_path / "sheet.html")
    assert read(tmp_path / "sheet.html").images == 6
    write_unwrap_report(UnwrapReport("hall.mp4", [], interrupted="disk full"), tmp_path / "none.html")
    text = read(tmp_path / "none.html").text
    assert "Interrupted (disk full)" in text and "No frame was unwrapped" in text


def test_verdict_says_scale_and_error(report: SlamReport) -> None:
    assert verdict(report) == (
        "Every one of 40 frames was tracked; lengths are METRIC, known to 0.8 % (1 sigma); "
        "the path is 3.0 cm off the truth (root mean square), 1.2 cm when scale is fitted too."
    )
    free = replace(report, metric=False, scale_sigma=np.inf, truth=None, tracked=39)
    assert verdict(free) == (
        "39 of 40 frames were tracked (97.5 %); lengths are NOT METRIC: nothing in the film fixed the scale."
    )
    assert "NOT METRIC, known only to 12 %" in verdict(replace(report, metric=False, scale_sigma=0.12))
    assert "NOT METRIC: the rig does not fit the film" in verdict(replace(free, rig_denied=True))


def test_a_share_just_under_all_is_not_called_all(report: SlamReport) -> None:
    long = replace(report, times=np.arange(10_000) / 10, tracked=9_999, truth=None)
    assert "(99.9 %)" in verdict(long)


def test_runs_without_frames_or_path_give_a_page(
    report: SlamReport, empty: SlamReport, tmp_path: Path
) -> None:
    write_slam_report(replace(empty, interrupted="Ctrl-C"), tmp_path / "empty.html")
    assert "Interrupted (Ctrl-C) after 0 frames: no frame was read." in read(tmp_path / "empty.html").text
    one = replace(empty, times=np.zeros(1), statuses=["STARTING"], predicted=np.zeros((1, 2), int),
                  inliers=np.zeros((1, 2), int))  # fmt: skip
    write_slam_report(one, tmp_path / "one.html")
    assert "None of 1 frame could be tracked" in read(tmp_path / "one.html").text
    cut = replace(report, interrupted="SIGTERM")
    write_slam_report(cut, tmp_path / "cut.html")
    assert "Interrupted (SIGTERM) after 40 frames: every one" in read(tmp_path / "cut.html").text


def test_names_from_outside_cannot_break_the_page(report: SlamReport, tmp_path: Path) -> None:
    nasty = "<script>alert(1)</script>.mp4"
    write_slam_report(replace(report, title=nasty, view_names=("a<b", "$x_{$")), tmp_path / "page.html")
    html = (tmp_path / "page.html").read_text()
    assert "<script" not in html
    assert nasty in read(tmp_path / "page.html").text


def test_an_unwritable_place_is_one_line(report: SlamReport, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="cannot be written") as caught:
        write_slam_report(report, tmp_path / "absent" / "report.html")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_points_are_drawn_where_they_are(dtype: type) -> None:
    image = np.zeros((200, 400), dtype)
    drawn = draw_points(image, np.array([[300.0, 100.0]]), np.array([2]), width=200)
    assert drawn.shape == (100, 200, 3)
    rows, columns = np.nonzero(drawn.any(axis=2))
    assert abs(columns.mean() - 149.75) < 0.3 and abs(rows.mean() - 49.75) < 0.3
    assert (np.abs(drawn.astype(int) - view_bgr(2)).sum(axis=2) < 30).any()


def test_drawing_leaves_the_picture_as_it_was() -> None:
    image = np.zeros((50, 50, 3), np.uint8)
    draw_points(image, np.array([[25.0, 25.0]]), np.array([0]), width=50)
    assert not image.any()


@pytest.mark.parametrize(
    ("spread", "plane"),
    [((3, 2, 0.1), [0, 1]), ((2, 0.3, 1), [0, 2]), ((0.1, 2, 2), [1, 2]), ((0, 0, 0), [0, 1])],
)
def test_the_path_is_drawn_along_its_ground(spread: tuple[float, ...], plane: list[int]) -> None:
    path = np.random.default_rng(3).uniform(0, 1, (50, 3)) * spread
    assert ground(path) == plane
